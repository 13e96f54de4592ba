"""Engines advance a State. `yade` is YADE itself, the reference; `fused` is labkit's own, compiled."""

from __future__ import annotations

from labkit.errors import InputError

ENGINES = ("yade", "fused")


def start_engine(name, state, threads=1):
    """The engine of that name, holding `state`. Raises InputError for an unknown name."""
    if name == "yade":
        from labkit.engines.yade import YadeEngine

        return YadeEngine(state, threads)
    if name == "fused":
        from labkit.engines.fused import FusedEngine

        return FusedEngine(state, threads)
    raise InputError(f"engine {name!r} is unknown: use one of {', '.join(ENGINES)}")
