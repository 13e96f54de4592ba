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

ENGINES: Registry = Registry(
    "engine", {"yade": "labkit.engines.yade:YadeEngine", "fused": "labkit.engines.fused:FusedEngine"}
)


def require_engine(name: str, scene: Scene) -> type[Engine]:
    """The engine class of that name. Raises InputError for an unknown name, or a scene that it cannot take."""
    kind: type[Engine] = ENGINES.require(name)
    kind.require(scene)
    return kind


def start_engine(name: str, state: State, threads: int = 1) -> Engine:
    """The engine of that name, holding `state`. Raises InputError for an unknown name or a scene it cannot take."""
    return require_engine(name, state.scene)(state, threads)  # type: ignore[call-arg]


def starter(name: str, threads: int = 1) -> Start:
    """A function that starts the engine of that name with a state."""
    return lambda state: start_engine(name, state, threads)


__all__ = ["ENGINES", "Engine", "require_engine", "start_engine", "starter"]
