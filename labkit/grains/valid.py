"""Checks that the values of a State can represent grains in a cell."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from labkit.errors import InputError
from labkit.io.schema import HISTORY, LARGEST_RADIUS, SIZES
from labkit.micro.cells import widths
from labkit.micro.snapshot import branch_vectors

if TYPE_CHECKING:
    from labkit.grains.state import State

FAR = 1000  # cell lengths; no grain travels that far
LARGEST = 1e30  # SI units; every quantity of a specimen is smaller
MOST_OVERLAP = 0.2  # largest mean overlap divided by the mean diameter; the checks of a run are stricter
NARROWEST = 0.8  # smallest width of the cell divided by the diameter of its largest grain
FARTHEST = 0.5  # largest gap in a contact divided by the mean diameter of its grains


def read_valid(path: str | os.PathLike[str], read: Callable[[], State]) -> State:
    """Return the State that `read` reads from the file `path`. Raises InputError for a State that cannot be valid."""
    try:
        state = read()
        require_valid(state)
        return state
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error}): create it again") from None


def require_fitting(state: State) -> None:
    """Raise ValueError if the arrays of a state have inconsistent shapes, contain NaN or refer to missing grains."""
    contacts, known = len(state.contact_grain), state.columns.keys() & HISTORY.keys()
    if len(known) < len(state.columns):
        raise ValueError(f"no part of a contact law keeps a history named {min(state.columns.keys() - known)}")
    for name, values in state.arrays.items():
        variable, sizes = state.table[name], {**SIZES, **state.sizes}
        if values.shape != tuple(sizes[dimension] for dimension in variable.dimensions):
            raise ValueError(f"{name} has the wrong shape {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} contains NaN or infinite values")
        if np.abs(values).max(initial=0) > LARGEST:
            raise ValueError(f"{name} contains values above {LARGEST:g}")
    if not state.number_of_grains:
        raise ValueError("it has no grains")
    if contacts and not (state.contact_grain.min() >= 0 and state.contact_grain.max() < state.number_of_grains):
        raise ValueError("contact_grain refers to grains that do not exist")
    if contacts and np.abs(state.contact_shift).max() > 2 * FAR:
        raise ValueError(f"contact_shift contains shifts of more than {2 * FAR} cells")


def require_valid(state: State) -> None:
    """Raise ValueError if the values of a state cannot represent grains in a cell."""
    require_fitting(state)
    if not ((state.radius > 0.0) & (state.radius < LARGEST_RADIUS)).all():
        raise ValueError(f"radius contains values that are not between 0 and {LARGEST_RADIUS:g} m")
    _require_cell(state)
    if len(state.contact_grain):
        _require_contacts(state)


def _require_cell(state: State) -> None:
    """Raise ValueError for a cell that cannot hold the grains."""
    if not state.volume > 0.0:
        raise ValueError("the cell has no volume, or is left-handed")
    if widths(state.cell).min() < 2.0 * NARROWEST * state.radius.max():
        raise ValueError("the cell is narrower than its largest grain")
    if np.abs(np.linalg.solve(state.cell, state.position.T)).max() > FAR:
        raise ValueError(f"a grain lies more than {FAR} cell lengths from the periodic cell")


def _require_contacts(state: State) -> None:
    """Raise ValueError for contacts that grains cannot have."""
    grain, shift = state.contact_grain, state.contact_shift
    if ((grain[:, 0] == grain[:, 1]) & (shift == 0).all(axis=1)).any():
        raise ValueError("contact_grain lists a contact of a grain with itself")
    branch = branch_vectors(state.position, state.cell, grain, shift)
    sum_of_radii = state.radius[grain].sum(axis=1)
    overlap = 1.0 - np.linalg.norm(branch, axis=1) / sum_of_radii
    if overlap.mean() > MOST_OVERLAP:
        raise ValueError(
            f"its grains overlap by {overlap.mean():.0%} of their diameter on average, too deep for a contact law: "
            "relax them first, as labkit specimen does"
        )
    if overlap.min() < -FARTHEST:
        raise ValueError("contact_grain lists two grains that are far apart")
