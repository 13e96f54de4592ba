"""Runs that share a batch: each has an engine of its own, whose State is one of a Batch.

The runs take turns (turns.py). The kernels of some steps are launched for all States that have steps left; while the
GPU computes, the runs whose steps are done continue, each until it has further steps to make. What they compute from
the State of a record does not need their turn: it is done in other threads, for several runs at the same time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

import numpy as np

import labkit
from labkit.dem.corrections import Corrections
from labkit.dem.engine import Engine, Result, Start
from labkit.dem.instant import Instant
from labkit.dem.recorded import recorded
from labkit.dem.state import State
from labkit.engines.batches import MOST_THREADS
from labkit.engines.cuda.batch import Batch
from labkit.engines.cuda.device import SIMULATED
from labkit.engines.cuda.taken import TakenInstant
from labkit.engines.cuda.turns import Turn
from labkit.errors import PhysicsError

Work = Callable[[Start], None]


@dataclasses.dataclass
class Begin:
    """What a work waits for that starts its first engine: a place in the batch."""

    state: State


@dataclasses.dataclass
class Steps:
    """What a work waits for: time steps of the State at a place in the batch. begun: True once the batch has them."""

    place: int
    corrections: Corrections
    begun: bool = False


class Pool:
    """Works whose States are in one Batch. All calls of the device are made by the thread that calls `execute`.

    hurries: True to launch steps as soon as one work has steps to make; False to wait for those that compute a record,
    because each launch costs time in the simulator. It affects no result.
    """

    hurries = not SIMULATED

    def __init__(self, works: Sequence[Work], precision: str) -> None:
        """Starts nothing yet."""
        self._precision = precision
        self.threads = ThreadPoolExecutor(max(1, min(len(works), MOST_THREADS)))
        self._batch: Batch | None = None
        self._places: dict[Turn, int] = {}
        self._stresses: np.ndarray | None = None  # of all States, once they have been computed
        self._turns = [self._turn(work) for work in works]

    @property
    def batch(self) -> Batch:
        """The Batch, once it is there."""
        assert self._batch is not None, "no work has started an engine"
        return self._batch

    def execute(self) -> list[Exception | None]:
        """Do all works; return for each the exception that ended it, or None."""
        try:
            self._proceed(self._turns)
            self._place()
            while waiting := [turn for turn in self._turns if not turn.ended]:
                self._continue(waiting)
        except BaseException as error:  # of the device: every work ends with it, and closes its files
            for turn in self._turns:
                while not turn.ended:
                    turn.proceed(error=error)
            if not isinstance(error, Exception):
                raise
        finally:
            self.threads.shutdown()
        return [turn.failure for turn in self._turns]

    def _turn(self, work: Work) -> Turn:
        return Turn(lambda turn: work(self._start(turn)))

    def _start(self, turn: Turn) -> Start:
        """The Start of a work: its first engine takes a place in the batch, every later one the same place."""

        def make(state: State, threads: int) -> Engine:
            if turn in self._places:
                turn.ask(lambda: self.load(self._places[turn], state))
            else:
                turn.ask(Begin(state))
            member = Member(self, turn, self._places[turn])
            member.require_going()
            return member

        return Start("cuda", 1, make, self._precision)

    def _proceed(self, turns: Sequence[Turn]) -> None:
        """Let works continue until each waits for a place or for steps, or ends."""
        for turn in turns:
            turn.proceed()
            while callable(turn.wanted):
                try:
                    answer = turn.wanted()
                except Exception as error:
                    turn.proceed(error=error)
                else:
                    turn.proceed(answer)

    def _place(self) -> None:
        """Make the batch of the States with which works begin, and let these works continue."""
        waiting = [turn for turn in self._turns if not turn.ended]
        if waiting:
            self._batch = Batch([turn.wanted.state for turn in waiting], self._precision)
            self._places = {turn: place for place, turn in enumerate(waiting)}
            self._proceed(waiting)

    def _continue(self, waiting: Sequence[Turn]) -> None:
        """Launch steps, let works continue beside them, and wait for the steps; or for a thread, if there are none."""
        computing = [turn.wanted for turn in waiting if isinstance(turn.wanted, Future)]
        for wanted in (turn.wanted for turn in waiting):
            if isinstance(wanted, Steps) and not wanted.begun:
                self.batch.begin(wanted.place, wanted.corrections)
                wanted.begun = True
        launched = self.batch.going.any() and (self.hurries or not computing)
        if launched:
            self._stresses = None
            self.batch.launch()
        ready = [turn for turn in waiting if self._is_done(turn.wanted)]
        self._proceed(ready[:1] if self.hurries and not launched else ready)
        if launched:
            self._stresses = None
            self.batch.look()
        elif not ready:
            wait(computing, return_when=FIRST_COMPLETED)

    def _is_done(self, wanted: Any) -> bool:
        """True if what a work waits for is there."""
        return wanted.done() if isinstance(wanted, Future) else not self.batch.going[wanted.place]

    def stress(self, place: int) -> np.ndarray:
        """Love's stress of one State, (3, 3), Pa; those of all States are computed together."""
        if self._stresses is None:
            self._stresses = self.batch.stress()
        return self._stresses[place].copy()

    def load(self, place: int, state: State) -> None:
        """Replace the State at a place."""
        self._stresses = None
        self.batch.load(place, state)

    def stop_grains(self, place: int) -> None:
        """Set the velocities of the State at a place to zero."""
        self._stresses = None
        self.batch.stop_grains(place)


class Member(Engine):
    """The engine of one work: the State at a place in the batch of a Pool."""

    name = "cuda"
    follows = True
    version = labkit.__version__

    def __init__(self, pool: Pool, turn: Turn, place: int) -> None:
        """The State is in the batch already."""
        self._pool, self._turn, self._place = pool, turn, place

    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        if steps > 0:
            self.follow(Corrections.constant(steps, velocity_gradient))

    def follow(self, corrections: Corrections) -> None:
        self._turn.ask(Steps(self._place, corrections))
        self.require_going()

    def stress(self) -> np.ndarray:
        return self._turn.ask(lambda: self._pool.stress(self._place))

    def state(self) -> State:
        return self.beside(self._turn.ask(lambda: self._pool.batch.take(self._place)).state)

    def instant(self) -> Instant:
        return TakenInstant(self._turn.ask(lambda: self._pool.batch.take(self._place)))

    def beside(self, work: Callable[..., Result], *arguments: Any) -> Result:
        if recorded():  # statistics of a user, which may open files
            return work(*arguments)
        future = self._pool.threads.submit(work, *arguments)
        self._turn.ask(future)
        return future.result()

    def load(self, state: State) -> None:
        self._turn.ask(lambda: self._pool.load(self._place, state))
        self.require_going()

    def stop_grains(self) -> None:
        self._turn.ask(lambda: self._pool.stop_grains(self._place))

    def require_going(self) -> None:
        """Raise PhysicsError if the State failed."""
        failure = self._pool.batch.failures[self._place]
        if failure is not None:
            raise PhysicsError(failure)
