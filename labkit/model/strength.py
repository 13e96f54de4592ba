"""Sections of strength criteria in the deviatoric (pi) plane: q/p as a function of the Lode angle.

Principal stresses at the Lode angle theta, 0 in triaxial compression and 60 degrees in extension:

    sigma_i = p + 2/3 q c_i,    c = cos(theta), cos(theta - 120), cos(theta + 120)

Each criterion is scaled to the strength M = q/p in triaxial compression, sin(phi) = 3M/(6 + M).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import deviator, equivalent_stress, lode_angle, mean_stress
from labkit.model.equations import attractor_size, critical_force_anisotropy
from labkit.model.parameters import TABLE_2, Model
from labkit.sff.c0 import c0_stress

LARGEST = 3.0  # largest M: sin(phi) = 1


def principal_cosines(angle: np.ndarray) -> np.ndarray:
    """Return the three c_i of the principal stresses, (..., 3), largest first; `angle` is theta (...), degrees."""
    return np.cos(np.radians(np.asarray(angle, dtype=float)[..., None] + np.array([0.0, -120.0, 120.0])))


def _sine(strength: float) -> float:
    if not 0.0 < strength < LARGEST:
        raise InputError(field="strength", value=strength, allowed=f"q/p in compression, above 0 and below {LARGEST:g}")
    return 3.0 * strength / (6.0 + strength)


def mohr_coulomb(strength: float, angle: np.ndarray) -> np.ndarray:
    """q/p of the criterion of Mohr and Coulomb, sigma_1 - sigma_3 = sin(phi) (sigma_1 + sigma_3).

    Raises InputError for a strength out of range.

    Args:
        strength: M in triaxial compression.
        angle: Lode angle (...), degrees.
    """
    sine, c = _sine(strength), principal_cosines(angle)
    largest, least = c.max(axis=-1), c.min(axis=-1)
    return 3.0 * sine / (largest - least - sine * (largest + least))


def matsuoka_nakai(strength: float, angle: np.ndarray) -> np.ndarray:
    """q/p of the criterion of Matsuoka and Nakai (1974), I_1 I_2/I_3 = (9 - sin^2 phi)/(1 - sin^2 phi).

    The root is found by bisection between q = 0 and the q at which the least stress vanishes. Raises InputError for a
    strength out of range.

    Args:
        strength: M in triaxial compression.
        angle: Lode angle (...), degrees.
    """
    sine, c = _sine(strength), principal_cosines(angle)
    ratio = (9.0 - sine**2) / (1.0 - sine**2)
    low, high = np.zeros(c.shape[:-1]), -1.5 / c.min(axis=-1)
    for _ in range(60):
        middle = 0.5 * (low + high)
        s = 1.0 + 2.0 / 3.0 * middle[..., None] * c
        second = s[..., 0] * s[..., 1] + s[..., 1] * s[..., 2] + s[..., 2] * s[..., 0]
        inside = 3.0 * second < ratio * s.prod(axis=-1)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return 0.5 * (low + high)


def critical_section(
    angle: np.ndarray, model: Model = TABLE_2, void_ratio: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return (q/p, Lode angle of the stress) at the critical state for strain rates at Lode angles (...), degrees.

    At the critical state A, F and F^t are A^c, F^c and F^tc (attractors), and C0 gives the stress.
    """
    c = principal_cosines(angle)
    n = np.zeros((*c.shape, 3))
    n[..., [0, 1, 2], [0, 1, 2]] = c / np.linalg.norm(c, axis=-1, keepdims=True)
    ones = np.ones(c.shape[:-1])
    stress = c0_stress(1.0, ones, ones, 0.0 * ones, *attractors(n, model, void_ratio))
    return equivalent_stress(stress) / mean_stress(stress), lode_angle(stress)


def attractors(
    n: np.ndarray, model: Model, void_ratio: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A^c, F^c and F^tc of a model for directions n (..., 3, 3) of the strain rate (equations.attractor).

    The void ratio (default: e_cmax) matters only if the model has a DensityDependence or Reversals.
    """
    c = model.constants
    e = c.e_cmax if void_ratio is None else void_ratio
    N = np.sqrt(6.0) * deviator(n @ n)
    cosine = np.sum(N * n, axis=(-2, -1), keepdims=True)
    A_c, Ft_c = (attractor_size(*pair, e, c) for pair in ((c.A_c, c.A_Z), (c.Ft_c, c.Ft_Z)))
    F_c = critical_force_anisotropy(e, c)
    F_b, F_w = (0.0, 0.0) if c.K_F > 0.0 else (c.F_b, c.F_w)
    sizes = (A_c, c.A_b, c.A_w), (F_c, F_b, F_w), (Ft_c, c.Ft_b, c.Ft_w)
    A, F, Ft = (size * ((1.0 - b - w * cosine) * n + (b + w) * N) for size, b, w in sizes)
    return A, F, Ft


def model_section(strength: float, angle: np.ndarray, model: Model = TABLE_2) -> np.ndarray:
    """q/p of the critical state of the model (`critical_section`), scaled to the strength M in compression."""
    _sine(strength)
    ratio, reached = critical_section(np.linspace(0.0, 60.0, 241), model)
    return np.interp(np.asarray(angle, dtype=float), reached, strength * ratio / ratio[0])


SECTIONS: dict[str, Callable[[float, np.ndarray], np.ndarray]] = {
    "Mohr-Coulomb": mohr_coulomb,
    "Matsuoka-Nakai": matsuoka_nakai,
    "model": model_section,
}
