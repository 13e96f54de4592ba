"""Engines advance a State. `yade` is YADE itself, the reference; `fused` is labkit's own, compiled."""

from __future__ import annotations

from labkit.errors import InputError

ENGINES = ("yade", "fused")


def require_law(name, scene):
    """Raises InputError when the engine of that name does not know the contact law of the scene."""
    if name == "yade" and scene.law != "yade":
        raise InputError(f"engine yade does not know contact law {scene.law!r}: give --engine fused")


def start_engine(name, state, threads=1):
    """The engine of that name, holding `state`. Raises InputError for an unknown name."""
    require_law(name, state.scene)
    if name == "yade":
        from labkit.engines.yade import YadeEngine

        return YadeEngine(state, threads)
    if name == "fused":
        from labkit.engines.fused import FusedEngine

        return FusedEngine(state, threads)
    raise InputError(f"engine {name!r} is unknown: use one of {', '.join(ENGINES)}")
