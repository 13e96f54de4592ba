"""The ends of runs: conditions that ended them, and errors of runs that cannot be completed or started."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path as File
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.micro.cells import widths
from labkit.paths.path import Path
from labkit.paths.step import Here
from labkit.paths.steps import is_symmetric
from labkit.quantities.conditions import Condition, condition
from labkit.records.memory import RunInMemory

MOST_LISTED = 5  # largest number of steps to list


def met_conditions(
    path: Path, stop_when: str | None, records: Mapping[str, Any], undrained_stress: ArrayLike = ()
) -> tuple[str, ...]:
    """Name the conditions that ended steps of a complete run and the run itself, one clause each.

    A condition is checked at records: a clause gives the values reached there, and one record before.

    Args:
        path: The path.
        stop_when: Condition that ends the run, if any.
        records: Values of variables at all records, name -> (time, ...).
        undrained_stress: Attribute of the run file: stress at the start of undrained loading, (9,), Pa, 0 if drained.
    """
    found, symmetric = list[str](), is_symmetric(path)

    def at(record: int) -> dict[str, Any]:
        return {name: values[record] for name, values in records.items()}

    def clause(what: str, text: str, record: int) -> str:
        ended = condition(text, axisymmetric=symmetric)
        before = f"; {ended.reached(at(record - 1), first)} one record before" if record else ""
        return f"{what} ended when {text} ({ended.reached(at(record), first)}{before})"

    first, last = at(0), len(records["stress"]) - 1
    if np.any(undrained_stress):
        first["undrained_stress"] = np.reshape(undrained_stress, (3, 3))
    if path.phases and "path_step" in records:
        of_record, share = (np.asarray(records[name]) for name in ("path_step", "path_step_progress"))
        for number, step in enumerate(path.steps_from(Here()), start=1):
            reached = np.flatnonzero(of_record == number)
            if len(reached) and share[reached[-1]] < 1.0 - 1e-9:
                end = at(int(reached[-1]))
                met = (one.text for one in step.conditions if one.holds(end, first, symmetric))
                found += [clause(f"step {number}", text, int(reached[-1])) for text in itertools.islice(met, 1)]
    if len(found) > MOST_LISTED:
        found = [f"{len(found)} steps ended at their conditions, {found[-1]}"]
    if stop_when is not None and condition(stop_when, axisymmetric=symmetric).holds(at(last), first):
        found.append(clause("it", stop_when, last))
    contacts = records.get("coordination_number", ())
    if len(contacts) and contacts[-1] == 0.0:
        found.append("no grains touch any more (p = 0, Z = 0)")
    return tuple(found)


NEAR = 0.002  # difference of void ratios that is not worth a word


def void_ratio_at_start(made: float | None, start: float) -> str:
    """Say that a test starts at another nominal void ratio than that of its specimen; empty if the two agree.

    Args:
        made: Nominal void ratio to which the recipe of the specimen led, if any (Recipe.made_at).
        start: Nominal void ratio at the first record.
    """
    if made is None or abs(start - made) <= NEAR:
        return ""
    return f"the test starts at a nominal void ratio of {start:.4f}; the specimen was made at {made:.4f}"


def unfinished_error(reason: str, output: File | RunInMemory) -> PhysicsError:
    """Return the error of a run that cannot be completed; it names the file with the records, if any."""
    kept = "" if isinstance(output, RunInMemory) else f"; the records up to that point are in {output} (complete = 0)"
    return PhysicsError(reason + kept)


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
