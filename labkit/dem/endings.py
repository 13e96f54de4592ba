"""Errors of a run that cannot be completed, or must not be started."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as File
from typing import Any

import numpy as np

from labkit.dem.conditions import Condition
from labkit.errors import InputError, PhysicsError


def unfinished(reason: str, file: File) -> PhysicsError:
    """The error of a run that cannot be completed."""
    return PhysicsError(f"{reason}; the records up to there are in {file} (complete = 0)")


def require_false_at_start(stop_when: Condition | None, first: Mapping[str, Any]) -> None:
    """Raise InputError if the condition that ends a run is met before it starts."""
    if stop_when is not None and stop_when.holds(first, first):
        problem, allowed = "is already met at the start", "a condition that is met later on the path"
        raise InputError(problem, field="stop_when", value=stop_when.text, allowed=allowed, quoted=True)


def require_sane(values: dict[str, Any], step: int) -> None:
    """Raise PhysicsError if a record shows that the integration has become unstable."""
    if not np.isfinite(values["kinetic_energy"]):  # NaN if any position is
        raise PhysicsError(f"positions became NaN at step {step}: the time step is too large")
