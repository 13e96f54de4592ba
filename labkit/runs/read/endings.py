"""The ends of runs: conditions that ended them, and errors of runs that cannot be completed or started."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as File
from typing import Any

import numpy as np

from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.grains.state import State
from labkit.io.interruption import nothing_saved
from labkit.micro.cells import widths
from labkit.paths.path import Path
from labkit.paths.step import Here
from labkit.quantities.conditions import Condition, condition
from labkit.records.memory import RunInMemory

MOST_LISTED = 5  # largest number of steps to list


def met_conditions(path: Path, stop_when: str | None, records: Mapping[str, Any]) -> tuple[str, ...]:
    """Name the conditions that ended steps of a complete run and the run itself, one clause each.

    `records` holds the values of variables at all records, name -> (time, ...).
    """
    found = []
    if path.phases and "path_step" in records:
        of_record, share = (np.asarray(records[name]) for name in ("path_step", "path_step_progress"))
        for number, step in enumerate(path.steps_from(Here()), start=1):
            reached = share[of_record == number]
            if step.conditions and len(reached) and reached[-1] < 1.0 - 1e-9:
                found.append(f"step {number} ended when {step.conditions[0].text}")
    if len(found) > MOST_LISTED:
        found = [f"{len(found)} steps ended at their conditions, {found[-1]}"]
    if stop_when is not None:
        first, last = ({name: values[at] for name, values in records.items()} for at in (0, -1))
        found += ["it ended when " + stop_when] * condition(stop_when).holds(last, first)
    contacts = records.get("coordination_number", ())
    if len(contacts) and contacts[-1] == 0.0:
        found.append("no grains touch any more (p = 0, Z = 0)")
    return tuple(found)


def unfinished_error(reason: str, output: File | RunInMemory) -> PhysicsError:
    """Return the error of a run that cannot be completed; it names the file with the records, if any."""
    kept = "" if isinstance(output, RunInMemory) else f"; the records up to that point are in {output} (complete = 0)"
    return PhysicsError(reason + kept)


def interruption_error(output: File | RunInMemory, number: int) -> Interrupted:
    """Return the error of a run that was stopped by a signal."""
    if isinstance(output, RunInMemory):
        return nothing_saved(number)
    return Interrupted(
        f"stopped by signal {number}; {output} is saved: give the same command to resume it", 128 + number
    )


def require_false_at_start(stop_when: Condition | None, first: Mapping[str, object]) -> None:
    """Raise InputError if the condition that ends a run is already met at its start."""
    if stop_when is not None and stop_when.holds(first, first):
        problem, allowed = "is already met at the start", "a condition that is met later on the path"
        raise InputError(problem, field="stop_when", value=stop_when.text, allowed=allowed, quoted=True)


def too_thin(state: State) -> str:
    """Say in one sentence that the cell is thinner than two grains, so that the run cannot go on; empty if not."""
    width, needed = float(widths(state.cell).min()), 4.0 * float(state.radius.max())
    if width >= needed:
        return ""
    kind = "grains" if state.bodies is None else "spheres of clumps"
    return (
        f"the cell is only {width:.3g} m wide at step {state.step}, less than two of the largest {kind} "
        f"({needed:.3g} m): use a specimen with more grains"
    )


def require_sane(values: dict[str, Any], step: int) -> None:
    """Raise PhysicsError if a record shows that the integration has become unstable."""
    if not np.isfinite(values["kinetic_energy"]):  # NaN if any position is NaN
        raise PhysicsError(f"positions became NaN at step {step}: the time step is too large")
