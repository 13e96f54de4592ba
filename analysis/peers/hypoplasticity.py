"""Hypoplasticity with intergranular strain.

von Wolffersdorff, A hypoplastic relation for granular materials with a predefined limit state surface, Mechanics of
Cohesive-Frictional Materials 1 (1996) 251-271; Niemunis and Herle, Hypoplastic model for cohesionless soils with
elastic strain range, the same journal 2 (1997) 279-299. Here compression is positive, unlike in these papers.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from analysis.peers.invariants import cos_three_theta
from labkit.model.law import INTERNAL, STRESS, RateLaw
from labkit.model.rates import FINE, OUTSIDE
from labkit.model.tensors import Six, contract, deviatoric_part, norm, put_six, six_at, trace


def limit_factor(s: Six) -> float:
    """Return F of the Matsuoka-Nakai limit surface, 1 in compression; `s` is the deviator of sigma/tr(sigma)."""
    t, cos = np.sqrt(3.0) * norm(s), cos_three_theta(s)
    inside = t * t / 8.0 + (2.0 - t * t) / (2.0 - np.sqrt(2.0) * t * cos)
    return np.sqrt(max(inside, 0.0)) - t / (2.0 * np.sqrt(2.0))


def stiffness_factors(e: float, p: float, c: Any) -> tuple[float, float]:
    """Return (f_b f_e, f_d), the factors of barotropy and pyknotropy; f_d is negative where e < e_d."""
    a = np.sqrt(3.0) * (3.0 - np.sin(np.radians(c.phi_c))) / (2.0 * np.sqrt(2.0) * np.sin(np.radians(c.phi_c)))
    compressed = np.exp(-((3.0 * p / c.h_s) ** c.n))
    ei, ec, ed = c.e_i0 * compressed, c.e_c0 * compressed, c.e_d0 * compressed
    if e < ed:
        return 0.0, -1.0
    density = ((c.e_i0 - c.e_d0) / (c.e_c0 - c.e_d0)) ** c.alpha
    f_b = c.h_s / c.n * (1.0 + ei) / ei * (c.e_i0 / c.e_c0) ** c.beta * (3.0 * p / c.h_s) ** (1.0 - c.n)
    f_b /= 3.0 + a * a - np.sqrt(3.0) * a * density
    return f_b * (ec / e) ** c.beta, ((e - ed) / (ec - ed)) ** c.alpha


class Hypoplasticity(RateLaw):
    """Hypoplasticity with intergranular strain (von Wolffersdorff 1996, Niemunis and Herle 1997).

    Parameters: phi_c (degrees), h_s (Pa), n, e_d0, e_c0, e_i0, alpha, beta; R, m_R, m_T, beta_r, chi (intergranular
    strain; R = 0 disables it). Initially the intergranular strain is fully mobilised, as after isotropic compression.
    """

    name = "hypoplasticity"
    parameters: ClassVar = {
        "phi_c": (33.1, 10.0, 50.0),  # Hochstetten sand
        "h_s": (1.5e9, 1e6, 1e13),
        "n": (0.28, 0.05, 0.95),
        "e_d0": (0.55, 0.01, 2.0),
        "e_c0": (0.95, 0.05, 3.0),
        "e_i0": (1.05, 0.05, 4.0),
        "alpha": (0.25, 0.0, 2.0),
        "beta": (1.5, 0.0, 20.0),
        "R": (1e-4, 0.0, 1e-2),
        "m_R": (5.0, 1.0, 50.0),
        "m_T": (2.0, 0.4, 50.0),
        "beta_r": (0.5, 0.01, 10.0),
        "chi": (6.0, 0.1, 50.0),
    }
    internal: ClassVar = {"intergranular_strain": (6, 1e-4)}

    def begin(self, y: np.ndarray) -> None:
        y[INTERNAL : INTERNAL + 3] = self.values["R"] / np.sqrt(3.0)

    @staticmethod
    def rates(y: np.ndarray, D: Six, compressing: bool, c: Any, out: np.ndarray) -> int:
        sigma, delta = six_at(y, STRESS), six_at(y, INTERNAL)
        if not trace(sigma) > 0.0:
            return OUTSIDE
        f, f_d = stiffness_factors(y[0], trace(sigma) / 3.0, c)
        if f_d < 0.0:
            return OUTSIDE
        ratio = 1.0 / trace(sigma) * sigma
        deviator = deviatoric_part(ratio)
        a = np.sqrt(3.0) * (3.0 - np.sin(np.radians(c.phi_c))) / (2.0 * np.sqrt(2.0) * np.sin(np.radians(c.phi_c)))
        F = limit_factor(deviator)
        f /= contract(ratio, ratio)
        N = -f * f_d * F * a * (ratio + deviator)
        change, effective, full = D, D, norm(D)
        if c.R > 0.0:  # Eqs. 5 to 8 of Niemunis and Herle
            size = norm(delta)
            direction = (1.0 / size if size > 0.0 else 0.0) * delta
            rho, along = size / c.R, contract(direction, D)
            share = rho**c.chi
            beyond = 1.0 - c.m_T if along > 0.0 else c.m_R - c.m_T
            weight = share * c.m_T + (1.0 - share) * c.m_R
            effective = weight * D + share * beyond * along * direction
            full = share * max(along, 0.0)
            change = D + -(rho**c.beta_r) * max(along, 0.0) * direction
        linear = f * F * F * effective + f * a * a * contract(ratio, effective) * ratio
        out[0] = -(1.0 + y[0]) * trace(D)
        put_six(out, STRESS, linear + full * N)
        put_six(out, INTERNAL, change)
        return FINE
