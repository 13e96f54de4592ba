"""The interface of an engine, the engines by name, and the requests that a run makes of an engine.

A run is a generator that yields what it needs from an engine and receives the answers. A request is a Load, an Advance,
Corrections, or a function of the engine; `Device.drive` carries them out.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Generator
from typing import Any, ClassVar, TypeAlias, TypeVar

import numpy as np

from labkit.extensions import Registry, require_subclass
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.process.interruption import delay_interrupts
from labkit.records.energy import kinetic_energy
from labkit.records.schedule import CHECKPOINT_WORK, MOST_STEPS
from labkit.servo.plan import Corrections

Result = TypeVar("Result")
Answer: TypeAlias = Any  # its type depends on the kind of request

Progress = Callable[[float, str], None]  # (fraction done, current activity)


def accept(*_: object) -> None:
    """Accept everything; the default for the checks in Abilities."""


@dataclasses.dataclass(frozen=True)
class Abilities:
    """What an engine can do, and what it needs.

    Args:
        parallel: What the engine runs on, "threads" and MPI "ranks".
        clumps: True if the grains may be rigid clumps of spheres.
        checkpoint_work: Grains x time steps between two checkpoints of a run: some 10 s of work on one thread.
        checkpoint_steps: Most time steps between two checkpoints, which bounds their time for a few grains.
        precisions: Supported precisions; a precision other than "double" is passed to the constructor as `precision`.
        require_scene: Raises InputError if the engine does not support a Scene.
        require_computer: Raises InputError if this computer lacks what the engine needs.
        follow: Advances an engine by the steps of Corrections and runs their servo; None if labkit runs the servo.
    """

    parallel: tuple[str, ...] = ("threads",)
    clumps: bool = False
    checkpoint_work: int = CHECKPOINT_WORK
    checkpoint_steps: int = int(MOST_STEPS)
    precisions: tuple[str, ...] = ("double",)
    require_scene: Callable[[Scene], None] = accept
    require_computer: Callable[[], None] = accept
    follow: Callable[[Any, Corrections], None] | None = None


class Engine(abc.ABC):
    """Holds a State and advances it in time.

    Between calls, the forces of the next step are computed but the motion is not. To define an engine, subclass
    Engine and decorate the class with `@labkit.register_engine`; its constructor takes (state, threads).
    """

    name: ClassVar[str]
    version: str
    shares_state: ClassVar[bool] = True  # False if, of several ranks, only rank 0 needs the State
    abilities: ClassVar[Abilities] = Abilities()

    @abc.abstractmethod
    def load(self, state: State) -> None:
        """Replace the current state."""

    @abc.abstractmethod
    def advance(self, steps: int, velocity_gradient: np.ndarray) -> None:
        """Advance a number of steps while the cell deforms with the velocity gradient (3, 3), in 1/s."""

    @abc.abstractmethod
    def stress(self) -> np.ndarray:
        """Return the current Love stress, shape (3, 3), in Pa, compression positive."""

    def volume(self) -> float:
        """Return the current volume of the cell, m3."""
        return float(np.linalg.det(self.state().cell))

    @abc.abstractmethod
    def state(self) -> State:
        """Return a copy of the current State, with contacts sorted by grain and an up-to-date ledger."""

    def stop_grains(self) -> None:
        """Set all velocities to zero; the ledger adds the kinetic energy to the energy dissipated by damping."""
        state = self.state()
        lost = kinetic_energy(state)
        self.load(state.without_velocities().replace(ledger=state.ledger.plus(0.0, 0.0, 0.0, lost)))


def reload(engine: Engine) -> State:
    """Load the current state of an engine again, and return this state.

    A run that reloads its state at a checkpoint is bitwise identical to a run resumed from that checkpoint: both
    rebuild everything that the engine stores besides the state, such as the order of its lists.
    """
    state = engine.state()
    engine.load(state)
    return state


Kind = TypeVar("Kind", bound=Engine)

ENGINES = Registry[type[Engine]](
    "engine", {"yade": "labkit.engines.yade:YadeEngine", "fused": "labkit.engines.fused:FusedEngine"}
)


def register_engine(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of Engine under its `name`; use it as a class decorator."""
    require_subclass(kind, Engine)
    return ENGINES.register(kind)


def engine_class(name: str) -> type[Engine]:
    """Return the engine class `name`; this may import Numba. Raises InputError if the name is unknown."""
    with delay_interrupts():
        return ENGINES.require(name)


def silent(fraction: float, text: str) -> None:
    """Show no progress."""


@dataclasses.dataclass(frozen=True)
class Load:
    """Start the engine with a State, or load the State into a running engine; the answer is its Abilities."""

    state: State


@dataclasses.dataclass(frozen=True, eq=False)
class Advance:
    """Advance a number of time steps with a velocity gradient (3, 3), in 1/s."""

    steps: int
    velocity_gradient: np.ndarray


Request = Load | Advance | Corrections | Callable[[Engine], Answer]


def carry_out(
    corrections: Corrections, time_step: float, gradient: np.ndarray, follows: bool, stress: np.ndarray | None = None
) -> Generator[Request, Any, np.ndarray]:
    """Carry out Corrections; returns the last velocity gradient that the engine was given, (3, 3), in 1/s.

    Args:
        corrections: The coming time steps.
        time_step: Time step, s.
        gradient: Current velocity gradient, (3, 3), in 1/s.
        follows: True if the engine runs the servo.
        stress: Current stress, (3, 3), Pa, if it is already known.
    """
    if follows:
        yield corrections
        return gradient
    for row, steps in enumerate(corrections.steps):
        if corrections.servo is not None and stress is None:
            stress = yield lambda engine: engine.stress()
        volume = 1.0
        if corrections.servo is not None and corrections.servo.water is not None:
            volume = yield lambda engine: engine.volume()
        gradient = corrections.velocity_gradient(row, time_step, stress, gradient, volume)
        yield Advance(int(steps), gradient)
        stress = None
    return gradient
