"""Reversals of a cyclic test."""

from __future__ import annotations

import numpy as np


def turns(strain: np.ndarray) -> np.ndarray:
    """Indices of the records at which the axial strain (record,) reverses, without the first and last record."""
    return np.flatnonzero(np.diff(np.sign(np.diff(strain))) != 0) + 1
