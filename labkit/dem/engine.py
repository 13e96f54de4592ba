"""The interface between a simulation and an engine; the engines are in labkit.engines."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Hashable, Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np

from labkit.dem.corrections import Corrections
from labkit.dem.instant import Instant
from labkit.dem.loading import Path
from labkit.dem.scene import Scene
from labkit.dem.state import State

PRECISIONS = ("double", "mixed")  # of all engines

Progress = Callable[[float, str], None]  # (fraction done, current activity)

Result = TypeVar("Result")


class Engine(abc.ABC):
    """Holds a State and advances it in time.

    Between calls, an engine has computed the forces of a step but not yet the motion. To define an engine, subclass
    Engine and decorate the class with `@labkit.register_engine`; its constructor takes (state, threads).
    """

    name: ClassVar[str]
    parallel: ClassVar[str] = "threads"  # or "ranks", if it runs on several processes over MPI
    precisions: ClassVar[tuple[str, ...]] = ("double",)  # the constructor takes any other as `precision`
    follows: ClassVar[bool] = False  # True if `follow` runs the servo in the engine
    batches: ClassVar[bool] = False  # True if `together` advances the States of several runs at once
    version: str

    @classmethod
    def here(cls) -> bool:
        """True if the engine can run in this process; YADE needs its own interpreter."""
        return True

    @classmethod
    def elsewhere(cls, job: str, processors: int, progress: Progress) -> None:
        """Carry out the task in the file `job` in another process, for an engine that cannot run in this one."""
        raise NotImplementedError(f"the engine {cls.name} runs in every process, or must define `elsewhere`")

    @classmethod
    def require(cls, scene: Scene) -> None:
        """Raise InputError if the engine does not support the scene; by default any scene is supported."""
        return

    @classmethod
    def require_here(cls) -> None:
        """Raise InputError if this computer lacks what the engine needs, such as a GPU; by default it needs nothing."""
        return

    @classmethod
    def batch_key(cls, scene: Scene) -> Hashable:
        """Runs whose scenes have equal keys can be in one batch; for an engine with `batches`."""
        raise NotImplementedError

    @classmethod
    def batch_memory(cls, grains: int, precision: str = "double") -> float:
        """Memory, bytes, that a State with this number of grains takes in a batch."""
        raise NotImplementedError

    @classmethod
    def batch_room(cls) -> float:
        """Memory, bytes, for all States of a batch on this computer. Raises InputError if it has no such device."""
        raise NotImplementedError

    @classmethod
    def together(cls, works: Sequence[Callable[[Start], None]], precision: str = "double") -> list[Exception | None]:
        """Do works that each advance a State with engines from the Start that they get, all States together.

        Returns for each work the exception that ended it, or None. The failure of one work does not stop the others.
        """
        raise NotImplementedError

    @classmethod
    def require_path(cls, path: Path) -> None:
        """Raise InputError if the engine cannot follow the path; by default it can follow any."""
        return

    @abc.abstractmethod
    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        """Advance a number of steps while the cell deforms with the velocity gradient (3, 3), 1/s."""

    def follow(self, corrections: Corrections) -> None:
        """Advance by the steps of the corrections, of which the engine runs the servo; for an engine that `follows`."""
        raise NotImplementedError

    @abc.abstractmethod
    def stress(self) -> np.ndarray:
        """Current Love stress, shape (3, 3), Pa, compression positive."""

    @abc.abstractmethod
    def state(self) -> State:
        """A copy of the current State, with the contacts sorted by grain and the ledger up to date."""

    def instant(self) -> Instant:
        """This instant, for a record; by default from the State."""
        return Instant(self.state())

    def beside(self, work: Callable[..., Result], *arguments: Any) -> Result:
        """The result of work that does not use the engine; in a batch, other States may advance meanwhile.

        The work may run in another thread, at the same time as that of other runs: it must use no files.
        """
        return work(*arguments)

    @abc.abstractmethod
    def load(self, state: State) -> None:
        """Replace the current state."""

    @abc.abstractmethod
    def stop_grains(self) -> None:
        """Set all velocities to zero; the ledger counts their energy as dissipated by damping."""

    def reload(self) -> State:
        """Load the current state of the engine again, and return it.

        A run that passes through a checkpoint in this way is identical, to the last bit, to one that is resumed from
        it: anything that the engine holds besides the state, such as the order of its lists, is rebuilt in both.
        """
        state = self.state()
        self.load(state)
        return state


@dataclasses.dataclass(frozen=True)
class Start:
    """Starts an engine: `start(state)`.

    name: name of the engine; threads: number of threads; make: class of the engine, or a function of (state, threads);
    precision: in which it computes.
    """

    name: str
    threads: int
    make: Callable[[State, int], Engine]
    precision: str = "double"

    def __call__(self, state: State) -> Engine:
        """The engine, loaded with the state. Raises InputError if it does not support the scene."""
        return self.make(state.replace(precision=self.precision), self.threads)


def silent(fraction: float, text: str) -> None:
    """Progress function that shows nothing."""
