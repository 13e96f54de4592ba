"""Where a cyclic test turns."""

from __future__ import annotations

import numpy as np


def turns(strain: np.ndarray) -> np.ndarray:
    """Indices of the records at which the axial strain (record,) turns; the first and the last record are none."""
    return np.flatnonzero(np.diff(np.sign(np.diff(strain))) != 0) + 1
