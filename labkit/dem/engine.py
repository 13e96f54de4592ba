"""What a simulation asks of an engine. The engines themselves are in labkit.engines."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from labkit.dem.scene import Scene
from labkit.dem.state import State


class Engine(abc.ABC):
    """Holds a State and advances it; always stands between the forces and the motion of a step.

    An engine of your own is a subclass with `@labkit.register_engine`; its constructor takes (state, threads).
    """

    name: ClassVar[str]
    version: str

    @classmethod
    def here(cls) -> bool:
        """Whether it can run in this process; YADE runs in an interpreter of its own."""
        return True

    @classmethod
    def require(cls, scene: Scene) -> None:
        """Raises InputError when the engine cannot take the scene; here it takes any."""

    @abc.abstractmethod
    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        """Moves the cell with the velocity gradient (3, 3), 1/s, for a number of steps."""

    @abc.abstractmethod
    def stress(self) -> np.ndarray:
        """Love's stress now, shape (3, 3), Pa, compression positive."""

    @abc.abstractmethod
    def state(self) -> State:
        """The State now; a copy, with the contacts sorted by grain and the ledger (labkit.dem.energy) kept up."""

    @abc.abstractmethod
    def load(self, state: State) -> None:
        """Goes on from another state."""

    @abc.abstractmethod
    def stop_grains(self) -> None:
        """Sets all velocities to zero; the ledger counts their energy as damped."""

    def reload(self) -> State:
        """Goes on from the engine's own state, and returns it.

        A run that passes through a checkpoint so is the same, to the last bit, as one that is resumed
        from it: what an engine holds beside the state (the order of its lists) begins anew in both.
        """
        state = self.state()
        self.load(state)
        return state


@dataclasses.dataclass(frozen=True)
class Start:
    """Starts an engine with a state: `start(state)`. name: of the engine; threads; make: its class or a function."""

    name: str
    threads: int
    make: Callable[[State, int], Engine]

    def __call__(self, state: State) -> Engine:
        """The engine, holding the state. Raises InputError if it cannot take it."""
        return self.make(state, self.threads)


Progress = Callable[[float, str], None]  # (fraction done, what is going on)


def silent(fraction: float, text: str) -> None:
    """A Progress that shows nothing."""
