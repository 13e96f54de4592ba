"""Runs that share a batch: each is a generator, and its State is one of a Batch.

The kernels of some steps are launched for all States that have steps left; while the GPU computes, the runs whose
steps are done go on, each until it has further steps to make. Work that needs no engine is done in other threads, for
several runs at the same time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

import labkit
from labkit.engines.base import MOST_THREADS, Abilities, Engine
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.device import SIMULATED
from labkit.engines.requests import Advance, Load, Request, Work
from labkit.errors import PhysicsError
from labkit.grains.state import State
from labkit.quantities.recorded import recorded
from labkit.records.instant import Instant
from labkit.servo.plan import Corrections

Run = Generator[Request, Any, Any]


class Seat(Engine):
    """A run, and its State at a place in the batch of a Pool.

    wanted: the last request of the run, or the Future of its Work; None once it has ended; failure: the exception that
    ended it; going: True until the steps that it wants are made; pending: these steps, until the batch has them.
    """

    name = "cuda"
    version = labkit.__version__
    abilities = Abilities(
        follow=lambda seat, corrections: seat.begin(corrections),
        instant=lambda seat: seat.instant(),
    )

    def __init__(self, pool: Pool, run: Run) -> None:
        """The run has not begun."""
        self._pool, self.run = pool, run
        self.place = -1
        self.wanted: Request | Future[Any] | None = None
        self.going = False
        self.pending: Corrections | None = None
        self.failure: Exception | None = None

    def proceed(self, answer: Any = None, error: BaseException | None = None) -> None:
        """Let the run go on with an answer, or an error, until it wants something or ends."""
        try:
            self.wanted = self.run.send(answer) if error is None else self.run.throw(error)
        except StopIteration:
            self.wanted = None
        except BaseException as failure:
            self.wanted = None
            if not isinstance(failure, Exception):
                raise
            self.failure = failure

    def begin(self, corrections: Corrections) -> None:
        """Have the batch make the steps of the corrections, from its next launch on."""
        self.pending, self.going = corrections, True

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        if steps > 0:
            self.begin(Corrections.constant(steps, velocity_gradient))

    def stress(self) -> np.ndarray:
        return self._pool.stress(self.place)

    def state(self) -> State:
        return self._pool.batch.state(self.place)

    def instant(self) -> Instant:
        """This instant, whose State is made of what was read from the device when it is first needed."""
        taken = self._pool.batch.take(self.place)
        return Instant(taken.brief, taken.state)

    def load(self, state: State) -> None:
        self._pool.changed()
        self._pool.batch.load(self.place, state)
        self.require_going()

    def stop_grains(self) -> None:
        self._pool.changed()
        self._pool.batch.stop_grains(self.place)

    def require_going(self) -> None:
        """Raise PhysicsError if the State failed."""
        failure = self._pool.batch.failures[self.place]
        if failure is not None:
            raise PhysicsError(failure)


class Pool:
    """Runs whose States are in one Batch.

    hurries: True to launch steps as soon as one run has steps to make; False to wait for those that compute a record,
    because each launch costs time in the simulator. It affects no result.
    """

    hurries = not SIMULATED

    def __init__(self, runs: Sequence[Run], precision: str) -> None:
        """Starts nothing yet."""
        self._precision = precision
        self._threads = ThreadPoolExecutor(max(1, min(len(runs), MOST_THREADS)))
        self._batch: Batch | None = None
        self._stresses: np.ndarray | None = None  # of all States, once they have been computed
        self._seats = [Seat(self, run) for run in runs]

    @property
    def batch(self) -> Batch:
        """The batch; available once every run has loaded its first State, or has ended."""
        assert self._batch is not None, "no run has loaded a State"
        return self._batch

    def execute(self) -> list[Exception | None]:
        """Carry out all runs; return for each the exception that ended it, or None."""
        try:
            for seat in self._seats:
                seat.proceed()
            self._place()
            while waiting := [seat for seat in self._seats if seat.wanted is not None]:
                self._continue(waiting)
        except BaseException as error:  # of the device: every run ends with it, and closes its files
            for seat in self._seats:
                while seat.wanted is not None:
                    with contextlib.suppress(type(error)):
                        seat.proceed(error=error)
            if not isinstance(error, Exception):
                raise
        finally:
            self._threads.shutdown()
        return [seat.failure for seat in self._seats]

    def _place(self) -> None:
        """Make the batch of the States with which runs begin, and let these runs go on."""
        waiting = [seat for seat in self._seats if seat.wanted is not None]
        states = [seat.wanted.state for seat in waiting if isinstance(seat.wanted, Load)]
        assert len(states) == len(waiting), "a run begins with Load"
        if states:
            self._batch = Batch(states, self._precision)
        for place, seat in enumerate(waiting):
            seat.place = place
            try:
                seat.require_going()
            except PhysicsError as error:
                seat.proceed(error=error)
            else:
                seat.proceed(seat.abilities)
            self._answer(seat)

    def _answer(self, seat: Seat) -> None:
        """Answer a run until it wants steps, or work in another thread, or ends."""
        while seat.wanted is not None and not seat.going and not isinstance(seat.wanted, Future):
            try:
                answer = self._answer_of(seat, seat.wanted)
            except Exception as error:
                seat.proceed(error=error)
            else:
                if not seat.going and not isinstance(answer, Future):
                    seat.proceed(answer)

    def _answer_of(self, seat: Seat, request: Request) -> Any:
        """The answer to a request; a Future, or None with the seat `going`, if it takes time."""
        match request:
            case Advance(steps, gradient):
                return seat.advance(steps, gradient)
            case Corrections():
                return seat.begin(request)
            case Work(function, arguments):
                if recorded():  # statistics of a user, which may open files
                    return function(*arguments)
                seat.wanted = self._threads.submit(function, *arguments)
                return seat.wanted
            case Load(state):
                seat.load(state)
                return seat.abilities
            case _:
                return request(seat)

    def _continue(self, waiting: Sequence[Seat]) -> None:
        """Launch steps, let runs go on beside them, and wait for the steps; or for a thread, if there are none."""
        computing = [seat.wanted for seat in waiting if isinstance(seat.wanted, Future)]
        for seat in waiting:
            if seat.pending is not None:
                self.batch.begin(seat.place, seat.pending)
                seat.pending = None
        launched = self.batch.going.any() and (self.hurries or not computing)
        if launched:
            self.changed()
            self.batch.launch()
        ready = [seat for seat in waiting if self._is_done(seat)]
        for seat in ready[:1] if self.hurries and not launched else ready:
            self._go_on(seat)
        if launched:
            self.changed()
            self.batch.look()
        elif not ready:
            wait(computing, return_when=FIRST_COMPLETED)

    def _is_done(self, seat: Seat) -> bool:
        """True if what a run waits for is there."""
        return seat.wanted.done() if isinstance(seat.wanted, Future) else not self.batch.going[seat.place]

    def _go_on(self, seat: Seat) -> None:
        """Let a run go on whose steps or work are done."""
        try:
            answer = seat.wanted.result() if isinstance(seat.wanted, Future) else None
            seat.require_going()
        except Exception as error:
            seat.going = False
            seat.proceed(error=error)
        else:
            seat.going = False
            seat.proceed(answer)
        self._answer(seat)

    def stress(self, place: int) -> np.ndarray:
        """Love's stress of one State, (3, 3), Pa; those of all States are computed together."""
        if self._stresses is None:
            self._stresses = self.batch.stress()
        return self._stresses[place].copy()

    def changed(self) -> None:
        """Forget the stresses: a State has changed."""
        self._stresses = None
