"""Bins of directions with equal solid angle, and means over them."""

from __future__ import annotations

import numpy as np


def polar_bins(n: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Divide directions n (m, 3) into bins of equal solid angle about z.

    n and -n are treated as the same direction: the angle from z runs from 0 to 90 degrees. Returns the cosines
    of the edges (bins + 1,) and the bin of each row (m,).
    """
    edges = np.linspace(0.0, 1.0, bins + 1)
    return edges, np.clip((np.abs(n[:, 2]) * bins).astype(int), 0, bins - 1)


def bin_means(values: np.ndarray, bin_of: np.ndarray, bins: int) -> np.ndarray:
    """Return the mean of `values` (m,) in each bin `bin_of` (m,), shape (bins,); NaN for empty bins."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.bincount(bin_of, values, bins) / np.bincount(bin_of, minlength=bins)


def hemisphere_bins(n: np.ndarray, bands: int, sectors: int) -> np.ndarray:
    """Divide the hemisphere z > 0 into bins of equal solid angle; return the bin of each row, band * sectors + sector.

    Directions `n` (m, 3) with z < 0 are reflected. The bands have equal heights in z, the sectors equal azimuths.
    """
    up = np.where(n[:, 2:] < 0.0, -n, n)
    band = np.clip((up[:, 2] * bands).astype(int), 0, bands - 1)
    azimuth = np.mod(np.arctan2(up[:, 1], up[:, 0]), 2.0 * np.pi)
    return band * sectors + np.clip((azimuth / (2.0 * np.pi) * sectors).astype(int), 0, sectors - 1)
