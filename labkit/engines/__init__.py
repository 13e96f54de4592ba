"""Engines advance a State. `yade` is YADE itself, the reference."""

from __future__ import annotations

from labkit.errors import InputError

ENGINES = ("yade",)


def start_engine(name, state, threads=1):
    """The engine of that name, holding `state`. Raises InputError for an unknown name."""
    if name == "yade":
        from labkit.engines.yade import YadeEngine

        return YadeEngine(state, threads)
    raise InputError(f"engine {name!r} is unknown: use one of {', '.join(ENGINES)}")
