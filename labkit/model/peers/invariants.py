"""What the laws share: the Lode angle, the mean stress, and stresses of isotropic elasticity, in compiled code."""

from __future__ import annotations

import numpy as np

from labkit.micro.tensors import ROOT2
from labkit.model.compiled import jit
from labkit.model.tensors import IDENTITY, Six, add, deviatoric_part, multiply, norm, trace

ATMOSPHERE = 101.325e3  # Pa


@jit
def determinant(T: Six) -> float:
    """det(T)."""
    shear = T[0] * T[3] ** 2 + T[1] * T[4] ** 2 + T[2] * T[5] ** 2
    return T[0] * T[1] * T[2] - 0.5 * shear + T[3] * T[4] * T[5] / ROOT2


@jit
def cos_three_theta(s: Six) -> float:
    """sqrt6 tr(s^3)/|s|^3 of a deviator s, compression positive: 1 in triaxial compression, -1 in extension.

    It is 1 for s = 0.
    """
    size = norm(s)
    if size < 1e-14:
        return 1.0
    return min(1.0, max(-1.0, 3.0 * np.sqrt(6.0) * determinant(multiply(1.0 / size, s))))


@jit
def elastic_stress(G: float, K: float, strain: Six) -> Six:
    """2 G dev(strain) + K tr(strain) I, Pa."""
    return add(multiply(2.0 * G, deviatoric_part(strain)), multiply(K * trace(strain), IDENTITY))
