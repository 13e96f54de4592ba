"""Anisotropic critical state theory: plasticity whose state parameter depends on fabric and loading direction.

Li and Dafalias, Anisotropic critical state theory: role of fabric, Journal of Engineering Mechanics 138 (2012) 263-275.
Elasticity, plastic modulus and dilatancy follow Li and Dafalias, Dilatancy for cohesionless soils, Geotechnique
50 (2000) 449-460, in which the dilatancy state parameter zeta replaces psi.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from analysis.peers.invariants import (
    ATMOSPHERE,
    HOLD,
    ON_SURFACE,
    cos_three_theta,
    cos_three_theta_slope,
    direction_of,
    elastic_moduli,
)
from labkit.model.law import INTERNAL, STRESS, RateLaw
from labkit.model.rates import FINE, OUTSIDE
from labkit.model.tensors import IDENTITY, Six, contract, deviatoric_part, elastic_stress, norm, put_six, six_at, trace

LEAST = 1e-6  # below this stress ratio the strain rate sets the loading direction
REACHED, FABRIC = INTERNAL, INTERNAL + 1


def shape(x: float, c: float) -> tuple[float, float]:
    """(g, dg/dx): g is the critical stress ratio over its value in compression, c in extension; x = cos(3 theta)."""
    root = np.sqrt((1.0 + c * c) ** 2 - 4.0 * c * (1.0 - c * c) * x)
    g = 2.0 * c * (1.0 + c) / (root + 1.0 + c * c)
    return g, g * 2.0 * c * (1.0 - c * c) / (root * (root + 1.0 + c * c))


class AnisotropicCriticalState(RateLaw):
    """Anisotropic critical state theory (Li and Dafalias 2012).

    Parameters: G0, nu (elasticity); M_c, c (critical stress ratio); e0, lambda_c, xi (critical state line
    e0 - lambda_c (p/p_at)^xi); h1, h2, n (plastic modulus); d0, m (dilatancy); e_A (influence of fabric) and k_F (rate
    of fabric). The fabric tensor has norm 1 at the critical state; its default initial value is zero.
    """

    name = "acst"
    parameters: ClassVar = {
        "G0": (125.0, 1.0, 1e5),
        "nu": (0.05, 0.0, 0.49),
        "M_c": (1.25, 0.1, 2.5),
        "c": (0.75, 0.5, 0.999),
        "e0": (0.934, 0.1, 3.0),
        "lambda_c": (0.019, 1e-6, 1.0),
        "xi": (0.7, 0.05, 2.0),
        "h1": (3.15, 1e-3, 1e3),
        "h2": (3.05, -1e3, 1e3),
        "n": (1.1, 0.0, 50.0),
        "d0": (0.88, 0.0, 20.0),
        "m": (3.5, 0.0, 50.0),
        "e_A": (0.1, 0.0, 2.0),
        "k_F": (5.0, 0.0, 1e4),
    }
    internal: ClassVar = {"stress_ratio_reached": (1, 1.0), "fabric": (6, 1.0)}

    def begin(self, y: np.ndarray) -> None:
        sigma = six_at(y[STRESS:INTERNAL], 0)
        s = deviatoric_part(sigma)
        y[REACHED] = np.sqrt(1.5) * norm(s) / (trace(sigma) / 3.0) / shape(cos_three_theta(s), self.values["c"])[0]

    @staticmethod
    def rates(y: np.ndarray, D: Six, compressing: bool, c: Any, out: np.ndarray) -> int:
        sigma, e, F = six_at(y, STRESS), y[0], six_at(y, FABRIC)
        p = trace(sigma) / 3.0
        if not p > 0.0:
            return OUTSIDE
        G, K = elastic_moduli(e, p, c.G0, c.nu)
        out[:] = 0.0
        out[0] = -(1.0 + e) * trace(D)
        elastic = elastic_stress(G, K, D)
        put_six(out, STRESS, elastic)
        r = 1.0 / p * deviatoric_part(sigma)
        R = np.sqrt(1.5) * norm(r)
        u = direction_of(r, D, LEAST)
        g, slope = shape(cos_three_theta(u), c.c)
        normal = u - slope / g * cos_three_theta_slope(u)  # along d(R/g)/dr
        size = norm(normal)
        n = (1.0 / size if size > 0.0 else 0.0) * normal
        pushed = 2.0 * G * contract(n, D) - K * contract(n, r) * trace(D)
        if R / g < y[REACHED] - ON_SURFACE or pushed <= 0.0:
            return FINE
        psi = e - (c.e0 - c.lambda_c * (p / ATMOSPHERE) ** c.xi)
        zeta = psi - c.e_A * (contract(F, n) - 1.0)  # dilatancy state parameter; A = F:n
        modulus = G * (c.h1 - c.h2 * e) * (c.M_c * g * np.exp(-c.n * zeta) / max(R, LEAST) - 1.0)
        dilatancy = c.d0 * (np.exp(c.m * zeta) - R / (c.M_c * g))
        across = np.sqrt(2.0 / 3.0) * dilatancy
        L = pushed / (2.0 / 3.0 * modulus + 2.0 * G - K * across * contract(n, r))
        rate = elastic - L * (2.0 * G * n + K * across * IDENTITY)
        put_six(out, STRESS, rate)
        if R > LEAST:
            change = 1.0 / p * (deviatoric_part(rate) - trace(rate) / 3.0 * r)
            out[REACHED] = np.sqrt(1.5) / g * contract(normal, change) + HOLD * (R / g - y[REACHED]) * norm(D)
        put_six(out, FABRIC, c.k_F * L * (n - F))
        return FINE
