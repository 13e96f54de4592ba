"""Functions that the laws share: the Lode angle, directions of stress, and moduli of isotropic elasticity."""

from __future__ import annotations

import numpy as np

from labkit.micro.tensors import ROOT2
from labkit.model.tensors import Six, contract, deviatoric_part, norm, six_product

ATMOSPHERE = 101.325e3  # Pa


def determinant(T: Six) -> float:
    """det(T)."""
    shear = T[0] * T[3] ** 2 + T[1] * T[4] ** 2 + T[2] * T[5] ** 2
    return T[0] * T[1] * T[2] - 0.5 * shear + T[3] * T[4] * T[5] / ROOT2


def cos_three_theta(s: Six) -> float:
    """sqrt6 tr(s^3)/|s|^3 of a deviator s, compression positive: 1 in triaxial compression, -1 in extension.

    It is 1 for s = 0.
    """
    size = norm(s)
    if size < 1e-14:
        return 1.0
    return min(1.0, max(-1.0, 3.0 * np.sqrt(6.0) * determinant(1.0 / size * s)))


def cos_three_theta_slope(u: Six) -> Six:
    """|s| d cos(3 theta)/ds at s = |s| u: 3 sqrt6 (dev(u^2) - tr(u^3) u)."""
    uu = six_product(u, u)
    return 3.0 * np.sqrt(6.0) * (deviatoric_part(uu) - contract(uu, u) * u)


def direction_of(s: Six, D: Six, least: float) -> Six:
    """Return s/|s| or, where |s| is below `least`, the direction of the deviatoric strain rate."""
    chosen = s if norm(s) > least else deviatoric_part(D)
    size = norm(chosen)
    return (1.0 / size if size > 0.0 else 0.0) * chosen


HOLD = 1e3  # per unit of strain: the distance from a yield surface falls to 1/e within 0.1 % strain
ON_SURFACE = 1e-6  # distance in stress ratio below which a state is treated as on the yield surface


def elastic_moduli(e: float, p: float, G0: float, nu: float) -> tuple[float, float]:
    """(G, K), Pa, with G = G0 p_at (2.97 - e)^2/(1 + e) (p/p_at)^(1/2) and a constant Poisson ratio."""
    G = G0 * ATMOSPHERE * (2.97 - e) ** 2 / (1.0 + e) * np.sqrt(p / ATMOSPHERE)
    return G, G * 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
