"""Measures of a periodic cell."""

from __future__ import annotations

import numpy as np


def widths(cell: np.ndarray) -> np.ndarray:
    """Distances between opposite faces of a cell (3, 3), shape (3,), or of several, (..., 3, 3) to (..., 3)."""
    return 1.0 / np.linalg.norm(np.linalg.inv(cell), axis=-1)
