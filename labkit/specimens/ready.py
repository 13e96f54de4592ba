"""Makes a specimen ready for a test or a consolidation."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeAlias

from labkit.engines.base import Load, Request
from labkit.grains.state import State
from labkit.grains.time_step import require_stable
from labkit.records.limits import require_shallow

Answer: TypeAlias = Any  # what an engine answers to a request


def ready(specimen: State, guarded: bool = True) -> Generator[Request, Answer, State]:
    """Return the specimen ready for a test: at time zero, with the time step of its scene.

    A state without contacts, from a different program or placed by hand, gets the contacts that the engine detects, so
    that the energy balance and the stability limit include them from the start. Raises InputError if grains overlap too
    deeply, and PhysicsError if the test is `guarded` and the time step exceeds the stability limit.
    """
    state = specimen.replace(time=0.0, step=0, time_step=specimen.scene.time_step)
    if len(state.contact_grain) == 0:
        yield Load(state)
        state = yield lambda engine: engine.state()
    snapshot = state.snapshot()
    require_shallow(snapshot)
    if guarded:
        require_stable(state, snapshot)
    return state
