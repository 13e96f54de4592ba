"""Scalar strains. Each path uses one of them in figures, tables, progress messages and for the critical state.

A record contains the logarithmic strain tensor eps, compression positive. The `strain_measure` of a path is the scalar
of eps that describes the progress of the test.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np


@dataclasses.dataclass(frozen=True)
class StrainMeasure:
    """A scalar strain.

    Args:
        name: Name in labels.
        short: Short name in labels.
        at: Function that returns the scalar (...) of a strain (..., 3, 3).
        signed: False for a norm, which does not distinguish loading from unloading.
    """

    name: str
    short: str
    at: Callable[[np.ndarray], np.ndarray]
    signed: bool = True

    def accumulate(self, strain: np.ndarray) -> np.ndarray:
        """Return the strain (n,) accumulated up to each record, which also grows after reversals; strain (n, 3, 3)."""
        steps = np.diff(strain, axis=0)
        accumulated = np.abs(np.diff(self.at(strain))) if self.signed else self.at(steps)
        return np.concatenate([np.zeros(min(len(strain), 1)), np.cumsum(accumulated)])

    def reversals(self, strain: np.ndarray) -> np.ndarray:
        """Return the indices (k,) of records at which this strain reverses, empty for a norm; strain (n, 3, 3)."""
        if not self.signed:
            return np.zeros(0, dtype=int)
        steps = np.diff(self.at(strain))
        moving = np.flatnonzero(np.abs(steps) > REVERSAL)
        turned = np.flatnonzero(np.diff(np.sign(steps[moving])) != 0.0)
        return moving[turned] + 1


REVERSAL = 1e-6  # a smaller change of the strain between two records is treated as no change


def _shear_strain(strain: np.ndarray) -> np.ndarray:
    """Return horizontal displacement over height: gamma_xz = B_xz/B_zz with B = F F^T = exp(-2 eps)."""
    principal, direction = np.linalg.eigh(np.asarray(strain, dtype=float))
    B = np.einsum("...ik,...k,...jk->...ij", direction, np.exp(-2.0 * principal), direction)
    return 0.0 - B[..., 0, 2] / B[..., 2, 2]


AXIAL = StrainMeasure("axial strain", "axial strain", lambda strain: strain[..., 2, 2])
VOLUMETRIC = StrainMeasure("volumetric strain", "vol. strain", lambda strain: np.trace(strain, axis1=-2, axis2=-1))
SHEAR = StrainMeasure("shear strain gamma_xz", "gamma_xz", _shear_strain)
PURE_SHEAR = StrainMeasure("shear strain gamma_xz", "gamma_xz", lambda strain: 2.0 * strain[..., 0, 2])
NORM = StrainMeasure("strain |eps|", "|eps|", lambda strain: np.linalg.norm(strain, axis=(-2, -1)), signed=False)
