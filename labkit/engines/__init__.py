"""Engines advance a State.

yade          YADE itself, the reference; runs in YADE's own process
yade_process  how that process is started
fused         labkit's own, compiled: kernel/
"""

from __future__ import annotations

from labkit.dem.engine import Engine, Start
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.extensions import Registry
from labkit.lazy import attach

ENGINES: Registry = Registry(
    "engine", {"yade": "labkit.engines.yade:YadeEngine", "fused": "labkit.engines.fused:FusedEngine"}
)


def require_engine(name: str, scene: Scene) -> type[Engine]:
    """The engine class of that name. Raises InputError for an unknown name, or a scene that it cannot take."""
    kind: type[Engine] = ENGINES.require(name)
    kind.require(scene)
    return kind


def starter(name: str, threads: int = 1) -> Start:
    """What starts the engine of that name. Raises InputError for an unknown name; when it starts an engine, for a scene
    that this engine cannot take.
    """
    ENGINES.require(name)

    def make(state: State, threads: int) -> Engine:
        return require_engine(name, state.scene)(state, threads)  # type: ignore[call-arg]

    return Start(name, threads, make)


def register_engine(kind: type[Engine]) -> type[Engine]:
    """A decorator that makes a subclass of Engine known under its `name`."""
    return ENGINES.register(kind)


__getattr__, __dir__, __all__ = attach(
    __name__,
    {
        "FusedEngine": "fused",
        "YadeEngine": "yade",
        "die_with_parent": "yade_process",
        "find_yade": "yade_process",
        "execute": "tasks",
        "RunTask": "tasks",
        "SpecimenTask": "tasks",
        "ConsolidationTask": "tasks",
    },
)
__all__ += ["ENGINES", "Engine", "register_engine", "require_engine", "starter"]
