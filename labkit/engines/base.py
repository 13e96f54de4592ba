"""The interface of an engine, the engines by name, and the requests that a run makes of an engine.

A run is a generator that yields what it needs from an engine and receives the answers. A request is a Load, an Advance,
Corrections, or a function of the engine. `drive_engine` answers from one engine; another driver may serve a test.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Generator
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np

from labkit.errors import InputError
from labkit.extensions import Registry
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.io.interruption import delay_interrupts
from labkit.paths.path import Path
from labkit.records.energy import kinetic_energy
from labkit.servo.plan import Corrections

Result = TypeVar("Result")
Precision: TypeAlias = Literal["double", "mixed"]
Answer: TypeAlias = Any  # the kind of request determines its type

PRECISIONS = ("double", "mixed")  # all precisions that engines support

Progress = Callable[[float, str], None]  # (fraction done, current activity)


def accept(*_: object) -> None:
    """Accept everything; the default for checks of Abilities that an engine does not need."""


@dataclasses.dataclass(frozen=True)
class Abilities:
    """What an engine can do, and what it needs.

    Args:
        parallel: What `threads` counts: "threads" or MPI "ranks".
        clumps: True if the grains may be rigid clumps of spheres.
        precisions: Supported precisions; the constructor takes any other than "double" as `precision`.
        require_scene: Raises InputError if the engine does not support a Scene.
        require_path: Raises InputError if the engine cannot follow a Path.
        require_computer: Raises InputError if this computer lacks what the engine needs.
        follow: Advances an engine by the steps of Corrections and runs their servo; None if labkit runs the servo.
    """

    parallel: str = "threads"
    clumps: bool = False
    precisions: tuple[str, ...] = ("double",)
    require_scene: Callable[[Scene], None] = accept
    require_path: Callable[[Path], None] = accept
    require_computer: Callable[[], None] = accept
    follow: Callable[[Any, Corrections], None] | None = None


class Engine(abc.ABC):
    """Holds a State and advances it in time.

    Between calls, the forces of the next step are computed but the motion is not. To define an engine, subclass
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

    def stop_grains(self) -> None:
        """Set all velocities to zero; the ledger counts their energy as dissipated by damping."""
        state = self.state()
        lost = kinetic_energy(state)
        self.load(state.without_velocities().replace(ledger=state.ledger.plus(0.0, 0.0, 0.0, lost)))


def reload(engine: Engine) -> State:
    """Load the current state of an engine again, and return it.

    A run that does so at a checkpoint is identical, to the last bit, to one resumed from that checkpoint: whatever the
    engine holds besides the state, such as the order of its lists, is rebuilt in both.
    """
    state = engine.state()
    engine.load(state)
    return state


Kind = TypeVar("Kind", bound=Engine)

ENGINES = Registry[type[Engine]](
    "engine",
    {
        "yade": "labkit.engines.yade:YadeEngine",
        "fused": "labkit.engines.fused:FusedEngine",
    },
)


def register_engine(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of Engine under its `name`; use it as a class decorator."""
    return ENGINES.register(kind)


def engine_class(name: str) -> type[Engine]:
    """Return the engine class of that name, which may import Numba. Raises InputError if it is unknown."""
    with delay_interrupts():
        return ENGINES.require(name)


@dataclasses.dataclass(frozen=True)
class Start:
    """An engine and the hardware it runs on: `start(state)` returns the engine, loaded with the state.

    Args:
        name: Name of the engine.
        threads: Number of threads, or of MPI ranks.
        kind: Class of the engine.
        precision: Precision in which it computes, "double" or "mixed".
    """

    name: str
    threads: int
    kind: type[Engine] = dataclasses.field(repr=False, compare=False)
    precision: str = "double"

    def __call__(self, state: State) -> Engine:
        """Return the engine, loaded with the state. Raises InputError if it lacks the scene or the precision."""
        self.require_scene(state.scene)
        self.require_grains(state.clumps is not None)
        options = {} if self.precision == "double" else {"precision": self.precision}
        make: Callable[..., Engine] = self.kind
        return make(state.replace(precision=self.precision), self.threads, **options)

    def require_grains(self, clumps: bool) -> None:
        """Raise InputError if the grains are clumps and the engine does not support them."""
        if clumps and not self.kind.abilities.clumps:
            able = [name for name in ENGINES if ENGINES[name].abilities.clumps]
            raise InputError("does not support clumps", field="engine", value=self.name, allowed=" or ".join(able))

    def require_scene(self, scene: Scene) -> None:
        """Raise InputError if the engine does not support the scene or the precision."""
        abilities = self.kind.abilities
        abilities.require_scene(scene)
        if self.precision not in abilities.precisions:
            allowed = " or ".join(abilities.precisions)
            problem = f"is not available on the engine {self.name}"
            raise InputError(problem, field="precision", value=self.precision, allowed=allowed, quoted=True)


def starter(name: str, threads: int = 1, precision: str = "double") -> Start:
    """Return the Start that makes engines of that name. Raises InputError for an unknown name."""
    return Start(name, threads, engine_class(name), precision)


class Fused(Start):
    """labkit's own engine, on threads of this computer; `mixed` precision is faster."""

    def __init__(self, threads: int = 1, precision: Precision = "double") -> None:
        """Take the number of threads and the precision of the forces."""
        super().__init__(**vars(starter("fused", threads, precision)))


class Yade(Start):
    """YADE, the reference; it must be installed."""

    def __init__(self, threads: int = 1) -> None:
        """Take the number of threads."""
        super().__init__(**vars(starter("yade", threads)))


def start_of(engine: str | Start, threads: int = 1, precision: str = "double", ranks: int | None = None) -> Start:
    """Return the Start of an engine, given as a Start or as a name with a number of threads or ranks.

    Raises InputError for an unknown name, ranks for an engine with threads, threads for one with ranks, or threads or
    ranks in addition to a Start, which has its own.
    """
    if isinstance(engine, str):
        return starter(engine, processors(engine, threads, ranks), precision)
    for name, value, default in (("threads", threads, 1), ("precision", precision, "double"), ("ranks", ranks, None)):
        if value != default:
            problem = "is given in addition to an engine that has its own"
            raise InputError(problem, field=name, value=value, allowed=f"it in {type(engine).__name__}(...)")
    return engine


def processors(engine: str, threads: int = 1, ranks: int | None = None) -> int:
    """Number of threads, or of MPI ranks, that an engine runs on.

    Raises InputError if the engine has threads and ranks are given, or vice versa.
    """
    if engine_class(engine).abilities.parallel == "ranks":
        if threads != 1:
            raise InputError(
                f"do not apply to the engine {engine}", field="threads", value=threads, allowed="ranks instead"
            )
        return 1 if ranks is None else ranks
    if ranks is not None:
        instead = "threads instead, or engine lammps"
        raise InputError(f"do not apply to the engine {engine}", field="ranks", value=ranks, allowed=instead)
    return threads


def silent(fraction: float, text: str) -> None:
    """Progress function that shows nothing."""


@dataclasses.dataclass(frozen=True)
class Load:
    """Start the engine with a State, or load the State into a running engine; the answer is its Abilities."""

    state: State


@dataclasses.dataclass(frozen=True)
class Advance:
    """Advance a number of time steps with a velocity gradient (3, 3), 1/s."""

    steps: int
    velocity_gradient: np.ndarray


Request = Load | Advance | Corrections | Callable[[Engine], Answer]


def drive_engine(run: Generator[Request, Answer, Result], start: Start) -> Result:
    """Carry out a run with one engine and return its result. Raises what the run or the engine raises."""
    engine: Engine | None = None
    try:
        request = next(run)
        while True:
            try:
                if engine is None:
                    assert isinstance(request, Load), "a run begins with Load"
                    engine = start(request.state)
                    answer = engine.abilities
                else:
                    answer = answer_of(engine, request)
            except BaseException as error:  # the run closes its files
                request = run.throw(error)
            else:
                request = run.send(answer)
    except StopIteration as end:
        return end.value


def answer_of(engine: Engine, request: Request) -> Answer:
    """Return the answer of an engine to a request."""
    match request:
        case Advance(steps, gradient):
            return engine.advance(steps, gradient)
        case Corrections():
            assert engine.abilities.follow is not None
            return engine.abilities.follow(engine, request)
        case Load(state):
            engine.load(state)
            return engine.abilities
        case _:
            return request(engine)
