"""The interface between a simulation and an engine; the engines are in labkit.engines."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Generator, Hashable, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.paths.path import Path
from labkit.records.instant import Instant
from labkit.servo.plan import Corrections

PRECISIONS = ("double", "mixed")  # of all engines
MOST_THREADS = 8  # that compute records of a batch; one record of 14,000 grains takes one of them tens of milliseconds

Progress = Callable[[float, str], None]  # (fraction done, current activity)


class Batches(Protocol):
    """How an engine advances the States of several runs together.

    drive: carries out runs, generators that yield what they need of an engine (labkit.engines.requests); returns for
    each the exception that ended it, or None. The failure of one run does not stop the others.
    """

    def key(self, scene: Scene) -> Hashable:
        """Runs whose scenes have equal keys can be in one batch."""

    def memory(self, grains: int, precision: str = "double") -> float:
        """Memory, bytes, that a State with this number of grains takes in a batch."""

    def room(self) -> float:
        """Memory, bytes, for all States of a batch on this computer. Raises InputError if it has no such device."""

    def drive(self, runs: Sequence[Generator[Any, Any, Any]], precision: str = "double") -> list[Exception | None]:
        """Carry out all runs."""


def accept(*_: object) -> None:
    """Accept everything: a check of Abilities that an engine does not need."""


def instant_of(engine: Engine) -> Instant:
    """The instant of an engine, for a record, from its State."""
    return Instant(engine.state())


@dataclasses.dataclass(frozen=True)
class Abilities:
    """What an engine can do, and what it needs.

    Args:
        parallel: What `threads` counts, "threads" or MPI "ranks".
        precisions: The constructor takes any other than "double" as `precision`.
        require_scene: Raises InputError if the engine does not support a Scene.
        require_path: Raises InputError if the engine cannot follow a Path.
        require_computer: Raises InputError if this computer lacks what the engine needs, such as a GPU.
        instant: The instant of an engine, for a record; an engine on several ranks need not gather its grains.
        follow: Advances an engine by the steps of Corrections, of which it runs the servo; None: labkit runs it.
        batches: How the States of several runs advance together; None: one after the other.
    """

    parallel: str = "threads"
    precisions: tuple[str, ...] = ("double",)
    require_scene: Callable[[Scene], None] = accept
    require_path: Callable[[Path], None] = accept
    require_computer: Callable[[], None] = accept
    instant: Callable[[Any], Instant] = instant_of
    follow: Callable[[Any, Corrections], None] | None = None
    batches: Batches | None = None


class Engine(abc.ABC):
    """Holds a State and advances it in time.

    Between calls, an engine has computed the forces of a step but not yet the motion. To define an engine, subclass
    Engine and decorate the class with `@labkit.register_engine`; its constructor takes (state, threads).
    """

    name: ClassVar[str]
    version: str
    abilities: ClassVar[Abilities] = Abilities()

    @abc.abstractmethod
    def load(self, state: State) -> None:
        """Replace the current state."""

    @abc.abstractmethod
    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        """Advance a number of steps while the cell deforms with the velocity gradient (3, 3), 1/s."""

    @abc.abstractmethod
    def stress(self) -> np.ndarray:
        """Current Love stress, shape (3, 3), Pa, compression positive."""

    @abc.abstractmethod
    def state(self) -> State:
        """A copy of the current State, with the contacts sorted by grain and the ledger up to date."""

    @abc.abstractmethod
    def stop_grains(self) -> None:
        """Set all velocities to zero; the ledger counts their energy as dissipated by damping."""


def reload(engine: Engine) -> State:
    """Load the current state of an engine again, and return it.

    A run that passes through a checkpoint in this way is identical, to the last bit, to one that is resumed from it:
    anything that the engine holds besides the state, such as the order of its lists, is rebuilt in both.
    """
    state = engine.state()
    engine.load(state)
    return state


@dataclasses.dataclass(frozen=True)
class Start:
    """An engine and what it runs on: `start(state)` gives the engine, loaded with the state.

    Args:
        name: Name of the engine.
        threads: Number of threads, or of MPI ranks.
        make: Class of the engine, or a function of (state, threads).
        precision: Precision in which it computes, "double" or "mixed".
    """

    name: str
    threads: int
    make: Callable[[State, int], Engine] = dataclasses.field(repr=False, compare=False)
    precision: str = "double"

    def __call__(self, state: State) -> Engine:
        """The engine, loaded with the state. Raises InputError if it does not support the scene."""
        return self.make(state.replace(precision=self.precision), self.threads)


def silent(fraction: float, text: str) -> None:
    """Progress function that shows nothing."""
