"""Measures of a periodic cell."""

from __future__ import annotations

import itertools

import numpy as np

MOST_PAIRS, MOST_OF_A_GRAIN = 50_000_000, 200  # pairs that a search may list, in total and per grain


def widths(cell: np.ndarray) -> np.ndarray:
    """Return the distances between opposite faces of cells (..., 3, 3), shape (..., 3)."""
    return 1.0 / np.linalg.norm(np.linalg.inv(cell), axis=-1)


def relative_width(cell: np.ndarray, radius: np.ndarray) -> float:
    """Return the smallest width of one or more cells (..., 3, 3), divided by the diameter of the largest grain."""
    return float(widths(cell).min(initial=np.inf) / (2.0 * radius.max()))


def cell_corners(cell: np.ndarray) -> np.ndarray:
    """Return the corners (8, 3), in m, of a cell (3, 3) at the origin in VTK order: around the bottom, then the top."""
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return np.array([(*xy, z) for z, xy in itertools.product((0, 1), around)]) @ cell.T
