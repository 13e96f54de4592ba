"""Engines advance a State.

yade          the YADE engine, the reference; it runs inside YADE
yade_process  starts YADE as a child process
lammps        LAMMPS over MPI, the engine for specimens that one computer cannot hold
child         an engine in a child process
fused         labkit's own compiled engine; its loop is in kernel/
cuda          States on a GPU; needs numba-cuda
threads       number of threads of the fused engine
batches       runs that an engine advances together
tasks         specimens, consolidations and runs as values that any engine can execute
speed         speed of an engine, measured in a separate process
"""

from __future__ import annotations

from collections.abc import Callable

from labkit.dem.engine import Engine, Start
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.errors import InputError
from labkit.extensions import Registry
from labkit.lazy import attach

ENGINES: Registry = Registry(
    "engine",
    {
        "yade": "labkit.engines.yade:YadeEngine",
        "fused": "labkit.engines.fused:FusedEngine",
        "cuda": "labkit.engines.cuda.engine:CudaEngine",
        "lammps": "labkit.engines.lammps.engine:LammpsEngine",
    },
)


def require_engine(name: str, scene: Scene, precision: str = "double") -> type[Engine]:
    """Return the engine class of that name.

    Raises InputError if it is unknown or does not support the scene or the precision.
    """
    kind: type[Engine] = ENGINES.require(name)
    kind.require(scene)
    if precision not in kind.precisions:
        allowed = " or ".join(kind.precisions)
        raise InputError(
            f"is not available on the engine {name}", field="precision", value=precision, allowed=allowed, quoted=True
        )
    return kind


def starter(name: str, threads: int = 1, precision: str = "double") -> Start:
    """Return the Start that makes engines of that name.

    Raises InputError for an unknown name. The Start raises InputError for a scene or a precision that the engine does
    not support.
    """
    ENGINES.require(name)

    def make(state: State, threads: int) -> Engine:
        kind: Callable[..., Engine] = require_engine(name, state.scene, precision)
        return kind(state, threads) if precision == "double" else kind(state, threads, precision=precision)

    return Start(name, threads, make, precision)


def processors(engine: str, threads: int = 1, ranks: int | None = None) -> int:
    """Number of threads, or of MPI ranks, that an engine runs on.

    Raises InputError if the engine has threads and ranks are given, or the other way round.
    """
    parallel: str = ENGINES.require(engine).parallel
    if parallel == "ranks":
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


def register_engine(kind: type[Engine]) -> type[Engine]:
    """Register a subclass of Engine under its `name`; use it as a class decorator."""
    return ENGINES.register(kind)


__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "FusedEngine": "fused",
        "YadeEngine": "yade",
        "die_with_parent": "child",
        "find_yade": "yade_process",
        "yade_program": "yade_process",
        "execute": "tasks",
        "RunTask": "tasks",
        "SpecimenTask": "tasks",
        "ConsolidationTask": "tasks",
    },
)
__all__ += ["ENGINES", "Engine", "processors", "register_engine", "require_engine", "starter"]
