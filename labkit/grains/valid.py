"""Checks that the values of a State can represent grains in a cell: the same for files and for States in memory."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.errors import ImpossibleError, InputError, require_type
from labkit.files.schema import ATTRIBUTES, HISTORY, LARGEST_RADIUS, SIZES, Variable
from labkit.grains.ledger import Ledger
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.cells import widths
from labkit.micro.snapshot import branch_vectors

require = ImpossibleError.unless

A_STATE = "the result of labkit.make_specimen or labkit.read_state, or run.state"  # where a user gets a State
FAR = 1000  # cell lengths; no grain travels that far
LARGEST = 1e30  # SI units; every quantity of a specimen is smaller
MOST_OVERLAP = 0.2  # largest mean overlap divided by the mean diameter; the checks of a run are stricter
NARROWEST = 0.8  # smallest width of the cell divided by the diameter of its largest grain
ALONE = "the one of the original State: State.replace keeps what you do not name"
FARTHEST = 0.5  # largest gap in a contact divided by the mean diameter of its grains
ATTRIBUTES_OF_STATE = (
    "time",
    "time_step",
    "step",
    "seed",
    "history",
    "recipe",
    "provenance",
    "engine",
    "engine_version",
)


def read_valid(path: str | os.PathLike[str], read: Callable[[], State]) -> State:
    """Return the State that `read` reads from the file `path`. Raises InputError for a State that cannot be valid."""
    try:
        state = read()
        require_valid(state)
        return state
    except ImpossibleError as error:
        raise InputError(f"{path} is damaged ({error.finding}): create it again") from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): create it again") from None


def require_state(state: Any, field: str = "state") -> None:
    """Raise InputError, saying what to give instead, for an argument that is not a State of possible grains."""
    require_type(state, State, field, A_STATE)
    try:
        require_valid(state)
    except ImpossibleError as error:
        raise InputError(f"the {field} is not one of grains in a cell: {error}") from None


def require_fitting(state: State) -> None:
    """Raise ImpossibleError if the arrays of a state do not fit together, contain NaN or refer to missing grains."""
    _require_fields(state)
    for name, values in state.arrays.items():
        _require_array(values, state.table[name])
    sizes, grain, shift = {**SIZES, **state.sizes}, state.contact_grain, state.contact_shift
    for name, values in state.arrays.items():
        shape = tuple(sizes[dimension] for dimension in state.table[name].dimensions)
        require(values.shape == shape, name, f"has the wrong shape {values.shape}", f"the shape {shape}")
    require(state.number_of_grains, "radius", "has no grains", "at least one grain")
    in_range = grain.min(initial=0) >= 0 and grain.max(initial=0) < state.number_of_grains
    allowed = f"numbers from 0 to {state.number_of_grains - 1}"
    require(in_range, "contact_grain", "refers to grains that do not exist", allowed)
    near = shift.max(initial=0) <= 2 * FAR and shift.min(initial=0) >= -2 * FAR
    allowed = "the number of cell vectors to add to the second grain, e.g. 0"
    require(near, "contact_shift", f"contains shifts of more than {2 * FAR} cells", allowed)


def _require_fields(state: State) -> None:
    """Raise ImpossibleError for fields of a state that are not of their type."""
    kinds: dict[str, Any] = {"scene": Scene, "columns": Mapping, "ledger": Ledger, "clumps": Clumps | None}
    for name, kind in kinds.items():
        actual = type(getattr(state, name)).__name__
        require(isinstance(getattr(state, name), kind), name, f"is a {actual}", ALONE)
    for name in sorted(state.columns.keys() - HISTORY.keys()):
        allowed = f"{', '.join(state.scene.contact_law.columns)} at most"
        require(False, "columns", f"do not fit: no part of a contact law keeps a history named {name}", allowed)
    *energies, further = vars(state.ledger).values()
    fields = {name: getattr(state, name) for name in ATTRIBUTES_OF_STATE} | {
        "undrained_stress": np.array(state.undrained_stress or (0.0,) * 9),
        "ledger": np.array([*energies, *further.values()]),
    }
    for name, value in fields.items():
        (holds, meaning), _ = ATTRIBUTES[name]
        require(holds(value), name, f"is not {meaning}", ALONE)


def _require_array(values: np.ndarray, row: Variable) -> None:
    """Raise ImpossibleError if the values of a variable are not an array of finite numbers of its kind."""
    whole = row.dtype.startswith("i")
    numbers = isinstance(values, np.ndarray) and values.dtype.kind in ("iu" if whole else "fiu")
    what = f"array of {'whole ' * whole}numbers"
    allowed = f"a NumPy {what}, unmasked, with the dimensions ({', '.join(row.dimensions)})"
    right = numbers and values.ndim > 0 and not np.ma.is_masked(values)
    require(right, row.name, f"is not an {what}", allowed)
    require(np.isfinite(values).all(), row.name, "contains NaN or infinite values", "finite numbers")
    small = whole or np.abs(values).max(initial=0) <= LARGEST
    require(small, row.name, f"contains values above {LARGEST:g}", f"values in {row.units}")


def require_valid(state: State) -> None:
    """Raise ImpossibleError if the values of a state cannot represent grains in a cell."""
    require_fitting(state)
    positive = (state.radius > 0.0) & (state.radius < LARGEST_RADIUS)
    problem = f"contains values that are not between 0 and {LARGEST_RADIUS:g} m"
    require(positive.all(), "radius", problem, "radii in m, e.g. 1e-4")
    _require_cell(state)
    if state.clumps is not None:
        state.clumps.require_spheres(state.radius, state.position)
    if len(state.contact_grain):
        _require_pairs(state)
        _require_distances(state)


def _require_cell(state: State) -> None:
    """Raise ImpossibleError for a cell that cannot hold the grains."""
    vectors, widest = "three cell vectors in m, as right-handed columns", 2.0 * state.radius.max()
    require(state.volume > 0.0, "cell", "has no volume, or is left-handed", vectors)
    allowed = f"one at least {widest:.3g} m wide, or smaller grains"
    require(widths(state.cell).min() >= NARROWEST * widest, "cell", "is narrower than its largest grain", allowed)
    near = np.abs(np.linalg.solve(state.cell, state.position.T)).max() <= FAR
    problem = f"contains a grain more than {FAR} cell lengths from the periodic cell"
    require(near, "position", problem, "positions in m, in or near the cell")


def _require_pairs(state: State) -> None:
    """Raise ImpossibleError for pairs of grains that cannot be contacts, or are listed twice."""
    (a, b), shift = state.contact_grain.T.astype(np.int64), state.contact_shift
    same_body = (a == b) & ~shift.any(axis=1)
    allowed = "two different grains, or leave the contact out"
    require(not same_body.any(), "contact_grain", "lists a contact of a grain with itself", allowed)
    if state.clumps is not None:
        same_body = (state.clumps.body[a] == state.clumps.body[b]) & ~shift.any(axis=1)
        allowed = "spheres of different clumps, or leave the contact out"
        require(not same_body.any(), "contact_grain", "lists a contact within a clump", allowed)
    side = shift @ np.array([(4 * FAR + 1) ** 2, 4 * FAR + 1, 1])  # one number for a shift, odd
    side = np.where(a == b, np.abs(side), np.where(a < b, side, -side))
    pair = np.minimum(a, b) * state.number_of_grains + np.maximum(a, b)
    order = np.lexsort((side, pair))
    twice = order[1:][(np.diff(pair[order]) == 0) & (np.diff(side[order]) == 0)]
    example = " and ".join(map(str, state.contact_grain[twice[:1]].ravel()))
    problem = f"lists {len(twice)} contacts twice, e.g. of grains {example}"
    require(not len(twice), "contact_grain", problem, "each contact once")


def _require_distances(state: State) -> None:
    """Raise ImpossibleError for contacts that overlap too deeply or have a gap too wide, or for their history."""
    branch = branch_vectors(state.position, state.cell, state.contact_grain, state.contact_shift)
    sum_of_radii = state.radius[state.contact_grain].sum(axis=1)
    overlap = 1.0 - np.linalg.norm(branch, axis=1) / sum_of_radii
    problem = f"makes grains overlap by {overlap.mean():.0%} of their diameter on average, too deep for a contact law"
    advice = " (relax them first, as labkit specimen does)"
    require(overlap.mean() <= MOST_OVERLAP, "position", problem + advice, "relaxed grains")
    allowed = "grains that touch, and the contact_shift to the image of the second"
    require(overlap.min() >= -FARTHEST, "contact_grain", "lists two grains that are far apart", allowed)
    for name, column in state.scene.contact_law.columns.items():
        low, high = column.range
        if name not in state.columns or not math.isfinite(high):
            continue
        value = state.columns[name] / (sum_of_radii if column.units == "m" else 1.0)
        unit = " times the sum of the radii" if column.units == "m" else ""
        allowed = f"0, or {low:g}{f' to {high:g}' * (low < high)}{unit}"
        possible = (value == 0.0) | ((low <= value) & (value <= high))
        require(possible.all(), name, "contains values that grains cannot have", allowed)
