"""Registry of the engines."""

from __future__ import annotations

from typing import Literal, TypeAlias, TypeVar

from labkit.engines.base import Engine, Start, require_able
from labkit.errors import InputError
from labkit.extensions import Registry
from labkit.grains.scene import Scene
from labkit.io.interruption import uninterrupted

Precision: TypeAlias = Literal["double", "mixed"]
Kind = TypeVar("Kind", bound=Engine)

ENGINES = Registry[type[Engine]](
    "engine",
    {
        "yade": "labkit.engines.yade:YadeEngine",
        "fused": "labkit.engines.fused:FusedEngine",
    },
)


def engine_class(name: str) -> type[Engine]:
    """Return the engine class of that name, which may import Numba. Raises InputError if it is unknown."""
    with uninterrupted():
        return ENGINES.require(name)


def require_engine(name: str, scene: Scene, precision: str = "double") -> type[Engine]:
    """Return the engine class of that name.

    Raises InputError if it is unknown or does not support the scene or the precision.
    """
    kind = engine_class(name)
    require_able(kind, scene, precision)
    return kind


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

    Raises InputError if the engine has threads and ranks are given, or the other way round.
    """
    if engine_class(engine).abilities.parallel == "ranks":
        if threads != 1:
            raise InputError(
                f"are not for the engine {engine}", field="threads", value=threads, allowed="ranks instead"
            )
        return 1 if ranks is None else ranks
    if ranks is not None:
        raise InputError(
            f"are not for the engine {engine}", field="ranks", value=ranks, allowed="threads instead, or engine lammps"
        )
    return threads


def register_engine(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of Engine under its `name`; use it as a class decorator."""
    return ENGINES.register(kind)
