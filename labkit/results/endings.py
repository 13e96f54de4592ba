"""The paths and ends of runs in words, and errors of runs that cannot be completed or started."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path as File

import numpy as np
from numpy.typing import ArrayLike

from labkit.errors import InputError, PhysicsError
from labkit.grains.state import State
from labkit.micro.cells import widths
from labkit.parameters import Values
from labkit.paths.ending import endings_of
from labkit.quantities.conditions import Condition
from labkit.quantities.scalars import Facts
from labkit.records.memory import RunInMemory

LABORATORY = "laboratory"  # the engine of a measured test


def path_and_origin(attributes: Values) -> str:
    """Return the path of a run, and what made it, as text: `cp on fused`, or `cr, measured in a laboratory`."""
    engine = attributes["engine"]
    return str(attributes["path"]) + (", measured in a laboratory" if engine == LABORATORY else f" on {engine}")


def how_it_ended(attributes: Values, contacts: ArrayLike) -> tuple[str, ...]:
    """Name the conditions that ended steps of a run and the run itself or were never met, and a loss of all contacts.

    Args:
        attributes: Attributes of the run file.
        contacts: Coordination number at the records, (n,).
    """
    stop_when = json.loads(attributes.get("path_parameters") or "{}").get("stop_when")
    over = attributes["complete"] and "endings" in attributes  # 0.2.0.dev0 did not store whether it was met
    clauses = [*endings_of(attributes).words(stop_when if over else None)]
    if np.size(contacts) and np.ravel(contacts)[-1] == 0.0:
        clauses.append("no grains touch any more (p = 0, Z = 0)")
    return tuple(clauses)


NEAR = 0.002  # difference of void ratios that is not worth a word


def void_ratio_at_start(aim: float | None, start: float) -> str:
    """Say that a test starts at another nominal void ratio than that of its specimen; empty if the two agree.

    Args:
        aim: Nominal void ratio to which the recipe of the specimen led, if any (Recipe.made_at).
        start: Nominal void ratio at the first record.
    """
    if aim is None or abs(start - aim) <= NEAR:
        return ""
    return f"the test starts at a nominal void ratio of {start:.4f}; the specimen was made at {aim:.4f}"


def unfinished_error(reason: str, output: File | RunInMemory) -> PhysicsError:
    """Return the error of a run that cannot be completed; it names the file with the records, if any."""
    where = "" if isinstance(output, RunInMemory) else f"; the records up to that point are in {output} (complete = 0)"
    return PhysicsError(reason + where)


def require_false_at_start(stop_when: Condition | None, first: Mapping[str, object], facts: Facts) -> None:
    """Raise InputError if the condition that ends a run is already met at its first record."""
    if stop_when is not None and stop_when.holds(first, facts):
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


def require_sane(values: Values, step: int) -> None:
    """Raise PhysicsError if a record shows that the integration has become unstable."""
    if not np.isfinite(values["kinetic_energy"]):  # NaN if any position is NaN
        raise PhysicsError(f"positions became NaN at step {step}: the time step is too large")
