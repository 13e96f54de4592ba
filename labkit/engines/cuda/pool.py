"""Runs that share a batch: each is a generator, and its State is one of a Batch.

Kernels for several steps are launched for all States with steps left. While the GPU computes, runs whose steps are
done continue until they request further steps. Work that needs no engine runs in other threads, for several runs at a
time.
"""

from __future__ import annotations

import abc
import contextlib
import functools
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait

import numpy as np

import labkit
from labkit.engines.base import MOST_THREADS, Abilities, Answer, Engine, Load, Request, Run, Work, answer_of
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.device import SIMULATED
from labkit.errors import PhysicsError
from labkit.grains.state import State
from labkit.quantities.recorded import recorded
from labkit.records.instant import Instant
from labkit.servo.plan import Corrections


class BatchEngine(Engine):
    """One State of a batch, number `place`."""

    name = "cuda"
    version = labkit.__version__

    def __init__(self, batch: Batch, place: int = 0) -> None:
        """Take a batch that already holds the State."""
        self.batch, self.place = batch, place

    @abc.abstractmethod
    def follow(self, corrections: Corrections) -> None:
        """Advance by the steps of the corrections, with the servo on the GPU."""

    def load(self, state: State) -> None:
        self.batch.load(self.place, state)
        self.require_going()

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        if steps > 0:
            self.follow(Corrections.constant(steps, velocity_gradient))

    def stress(self) -> np.ndarray:
        return self.batch.stress()[self.place]

    def state(self) -> State:
        return self.batch.state(self.place)

    def require_going(self) -> None:
        """Raise PhysicsError if the State failed."""
        failure = self.batch.failures[self.place]
        if failure is not None:
            raise PhysicsError(failure)


class Seat(BatchEngine):
    """A run, and its State in the batch of a Pool.

    `wanted` is the last request of the run, or the Future of its Work, and None once the run has ended; `failure` is
    the exception that ended it. `going` is True until the requested steps are done; `pending` holds these steps until
    they are submitted to the batch.
    """

    abilities = Abilities(
        follow=lambda seat, corrections: seat.follow(corrections),
        instant=lambda seat: Instant(*seat.batch.take(seat.place)),  # its State is completed on first use
    )

    def __init__(self, run: Run) -> None:
        """Take a run that has not begun."""
        self.run = run
        self.wanted: Request | Future[Answer] | None = None
        self.going = False
        self.pending: Corrections | None = None
        self.failure: Exception | None = None

    def follow(self, corrections: Corrections) -> None:
        """Request the steps of the corrections; the batch makes them from its next launch on."""
        self.pending, self.going = corrections, True

    def proceed(self, answer: Answer = None, error: BaseException | None = None) -> None:
        """Continue the run with an answer, or an error, until its next request or its end."""
        try:
            self.wanted = self.run.send(answer) if error is None else self.run.throw(error)
        except StopIteration:
            self.wanted = None
        except BaseException as failure:
            self.wanted = None
            if not isinstance(failure, Exception):
                raise
            self.failure = failure

    @property
    def is_done(self) -> bool:
        """True if the answer that the run waits for is available."""
        return self.wanted.done() if isinstance(self.wanted, Future) else not self.batch.going[self.place]

    def outcome(self) -> Answer:
        """The answer to the first request, or to one that took time. Raises the error of the work or of the State."""
        self.going = False
        answer = self.wanted.result() if isinstance(self.wanted, Future) else self.abilities
        self.require_going()
        return answer


class Pool:
    """Runs whose States are in one Batch.

    `hurries` is True to launch steps as soon as one run has steps to make, or False to wait for runs that compute a
    record, because each launch is slow in the simulator. It affects no result.
    """

    hurries = not SIMULATED

    def __init__(self, runs: Sequence[Run], precision: str) -> None:
        """Take runs that have not begun."""
        self._precision, self._seats = precision, [Seat(run) for run in runs]
        self._threads = ThreadPoolExecutor(max(1, min(len(runs), MOST_THREADS)))

    def execute(self) -> list[Exception | None]:
        """Carry out all runs; return for each the exception that ended it, or None."""
        try:
            for seat in self._seats:
                seat.proceed()
            self._place([seat for seat in self._seats if seat.wanted is not None])
            while waiting := [seat for seat in self._seats if seat.wanted is not None]:
                self._continue(waiting[0].batch, waiting)
        except BaseException as error:  # a failure of the device ends every run, which then closes its files
            for seat in self._seats:
                while seat.wanted is not None:
                    with contextlib.suppress(type(error)):
                        seat.proceed(error=error)
            if not isinstance(error, Exception):
                raise
        finally:
            self._threads.shutdown()
        return [seat.failure for seat in self._seats]

    def _place(self, waiting: Sequence[Seat]) -> None:
        """Make the batch from the States with which runs begin, and continue these runs."""
        states = [seat.wanted.state for seat in waiting if isinstance(seat.wanted, Load)]
        assert len(states) == len(waiting), "a run begins with Load"
        batch = Batch(states, self._precision) if states else None
        for place, seat in enumerate(waiting):
            assert batch is not None
            seat.batch, seat.place = batch, place
            self._go_on(seat, seat.outcome)

    def _go_on(self, seat: Seat, find_answer: Callable[[], Answer]) -> None:
        """Continue a run with an answer, or the error in finding it, until it requests steps or work, or ends."""
        while True:
            try:
                answer = find_answer()
            except Exception as error:
                seat.proceed(error=error)
            else:
                if isinstance(answer, Future):
                    seat.wanted = answer
                if seat.going or isinstance(answer, Future):
                    return
                seat.proceed(answer)
            if seat.wanted is None or isinstance(seat.wanted, Future):
                return
            find_answer = functools.partial(self._answer_of, seat, seat.wanted)

    def _answer_of(self, seat: Seat, request: Request) -> Answer:
        """Return the answer to a request; a Future, or None with the seat `going`, if it takes time."""
        if isinstance(request, Work) and not recorded():  # a user's statistics may open files
            return self._threads.submit(request.function, *request.arguments)
        return answer_of(seat, request)

    def _continue(self, batch: Batch, waiting: Sequence[Seat]) -> None:
        """Launch steps, continue runs meanwhile, and wait for the steps; without steps, wait for a thread."""
        computing = [seat.wanted for seat in waiting if isinstance(seat.wanted, Future)]
        for seat in waiting:
            if seat.pending is not None:
                batch.begin(seat.place, seat.pending)
                seat.pending = None
        launched = batch.going.any() and (self.hurries or not computing)
        if launched:
            batch.launch()
        ready = [seat for seat in waiting if seat.is_done]
        for seat in ready[:1] if self.hurries and not launched else ready:
            self._go_on(seat, seat.outcome)
        if launched:
            batch.look()
        elif not ready:
            wait(computing, return_when=FIRST_COMPLETED)
