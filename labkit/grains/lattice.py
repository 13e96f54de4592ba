"""Replaces a periodic cell that shear has tilted by more than half a period with an equivalent cell.

The cells H and H U describe the same lattice if U has integer components and determinant 1. Grains stay where they are;
only the periodic shifts between contacting grains change.
"""

from __future__ import annotations

import numpy as np

from labkit.grains.state import State

MOST_TILT = 0.5 + 1e-6  # component of a cell vector along another cell vector, divided by the length of the latter


def _along(cell: np.ndarray) -> np.ndarray:
    """Return A (3, 3): A_ij is the component of cell vector i along vector j over the length of j; A_ii is zero."""
    product = cell.T @ cell
    along = product / np.diag(product)
    np.fill_diagonal(along, 0.0)
    return along


def tilt(cell: np.ndarray) -> float:
    """Return the largest component of a vector of `cell` (3, 3), in m, along another, over the length of the latter."""
    return float(np.abs(_along(cell)).max())


def reduction(cell: np.ndarray) -> np.ndarray:
    """Find the integer matrix U (3, 3) for which H U, with H = `cell` (3, 3) in m, is tilted by at most 1/2."""
    reduced, U = np.array(cell, dtype=float), np.eye(3)
    for _ in range(100):
        along = _along(reduced)
        i, j = np.unravel_index(np.abs(along).argmax(), (3, 3))
        if abs(along[i, j]) <= MOST_TILT:
            break
        periods = np.round(along[i, j])
        reduced[:, i] -= periods * reduced[:, j]
        U[:, i] -= periods * U[:, j]
    return U


def in_cell(state: State, U: np.ndarray) -> State:
    """Return the same grains and contacts in the equivalent cell `cell` @ U."""
    shift = state.contact_shift @ np.round(np.linalg.inv(U)).T
    cell = state.cell.copy()
    for k in range(3):  # one vector after another, so that an unchanged vector stays bitwise identical
        if (U[:, k] != np.eye(3)[k]).any():
            cell[:, k] = state.cell @ U[:, k]
    return state.replace(cell=cell, contact_shift=shift.astype(np.int32))
