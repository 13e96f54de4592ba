"""SANISAND 2004: bounding surface plasticity with a small yield cone and fabric dilatancy.

Dafalias and Manzari, Simple plasticity sand model accounting for fabric change effects, Journal of Engineering
Mechanics 130 (2004) 622-634.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from analysis.peers.invariants import ATMOSPHERE, HOLD, ON_SURFACE, cos_three_theta, elastic_moduli
from labkit.model.law import INTERNAL, STRESS, RateLaw
from labkit.model.rates import FINE, OUTSIDE
from labkit.model.tensors import (
    IDENTITY,
    Six,
    contract,
    deviatoric_part,
    elastic_stress,
    norm,
    put_six,
    six_at,
    six_product,
    trace,
)

ROOT_2_3 = np.sqrt(2.0 / 3.0)
ALPHA, ALPHA_IN, Z = INTERNAL, INTERNAL + 6, INTERNAL + 12
LEAST = 1e-10  # lower bound on (alpha - alpha_in):n; the plastic modulus is infinite at zero


def loading_direction(y: np.ndarray) -> tuple[Six, float]:
    """Return n (Eq. 21) and |s - p alpha|/p at a state y; n is zero on the axis of the cone."""
    sigma = six_at(y, STRESS)
    p = trace(sigma) / 3.0
    inside = 1.0 / p * deviatoric_part(sigma) - six_at(y, ALPHA)
    size = norm(inside)
    return (1.0 / size if size > 0.0 else 0.0) * inside, size


class Sanisand(RateLaw):
    """SANISAND (Dafalias and Manzari 2004).

    Parameters: G0, nu (elasticity); M, c (critical stress ratio); e0, lambda_c, xi (critical state line
    e0 - lambda_c (p/p_at)^xi); m (yield cone); h0, c_h, n_b (plastic modulus); A0, n_d (dilatancy); z_max, c_z (fabric
    dilatancy tensor).
    """

    name = "sanisand"
    parameters: ClassVar = {
        "G0": (125.0, 1.0, 1e5),  # Toyoura sand
        "nu": (0.05, 0.0, 0.49),
        "M": (1.25, 0.1, 2.5),
        "c": (0.712, 0.6, 1.0),
        "e0": (0.934, 0.1, 3.0),
        "lambda_c": (0.019, 1e-6, 1.0),
        "xi": (0.7, 0.05, 2.0),
        "m": (0.01, 1e-4, 0.2),
        "h0": (7.05, 1e-3, 1e4),
        "c_h": (0.968, 0.0, 2.0),
        "n_b": (1.1, 0.0, 50.0),
        "A0": (0.704, 0.0, 20.0),
        "n_d": (3.5, 0.0, 50.0),
        "z_max": (4.0, 0.0, 100.0),
        "c_z": (600.0, 0.0, 1e5),
    }
    internal: ClassVar = {"back_stress_ratio": (6, 1.0), "first_back_stress_ratio": (6, 1.0), "fabric": (6, 1.0)}

    def begin(self, y: np.ndarray) -> None:
        sigma = y[STRESS:INTERNAL]
        ratio = sigma / np.mean(sigma[:3])
        ratio[:3] -= 1.0
        y[ALPHA:ALPHA_IN], y[ALPHA_IN:Z] = ratio, ratio

    @staticmethod
    def settle(y: np.ndarray, c: Any) -> None:
        n, _ = loading_direction(y)
        if contract(six_at(y, ALPHA) - six_at(y, ALPHA_IN), n) < 0.0:
            put_six(y, ALPHA_IN, six_at(y, ALPHA))

    @staticmethod
    def rates(y: np.ndarray, D: Six, compressing: bool, c: Any, out: np.ndarray) -> int:
        sigma, alpha, z = six_at(y, STRESS), six_at(y, ALPHA), six_at(y, Z)
        p, e = trace(sigma) / 3.0, y[0]
        if not p > 0.0:
            return OUTSIDE
        G, K = elastic_moduli(e, p, c.G0, c.nu)  # Eqs. 6, 7
        out[:] = 0.0
        out[0] = -(1.0 + e) * trace(D)
        elastic = elastic_stress(G, K, D)
        put_six(out, STRESS, elastic)
        n, size = loading_direction(y)
        beyond = size - ROOT_2_3 * c.m  # f/p, Eq. 8
        r = 1.0 / p * deviatoric_part(sigma)
        pushed = 2.0 * G * contract(n, D) - K * contract(n, r) * trace(D)
        if beyond < -ON_SURFACE or pushed <= 0.0:
            return FINE
        psi = e - (c.e0 - c.lambda_c * (p / ATMOSPHERE) ** c.xi)  # Eq. 1
        nn = six_product(n, n)
        cos = cos_three_theta(n)
        g = 2.0 * c.c / (1.0 + c.c - (1.0 - c.c) * cos)  # Eq. 19
        bound = ROOT_2_3 * (g * c.M * np.exp(-c.n_b * psi) - c.m)  # Eq. 17
        dilating = ROOT_2_3 * (g * c.M * np.exp(c.n_d * psi) - c.m)  # Eq. 18
        distance = contract(alpha - six_at(y, ALPHA_IN), n)
        h = c.G0 * c.h0 * (1.0 - c.c_h * e) * (p / ATMOSPHERE) ** -0.5 / max(distance, LEAST)  # Eqs. 23, 24
        to_bound = bound * n - alpha
        dilatancy = c.A0 * (1.0 + max(contract(z, n), 0.0)) * (dilating - contract(alpha, n))  # Eqs. 25, 26, 28
        B = 1.0 + 1.5 * (1.0 - c.c) / c.c * g * cos  # Eq. 22
        C = 3.0 * np.sqrt(1.5) * (1.0 - c.c) / c.c * g
        flow = B * n - C * (nn - 1.0 / 3.0 * IDENTITY)
        resistance = 2.0 / 3.0 * p * h * contract(to_bound, n) + 2.0 * G * contract(flow, n)
        resistance -= K * dilatancy * contract(n, r)
        L = (pushed + HOLD * p * beyond * norm(D)) / resistance
        put_six(out, STRESS, elastic - L * (2.0 * G * flow + K * dilatancy * IDENTITY))
        put_six(out, ALPHA, 2.0 / 3.0 * L * h * to_bound)  # Eq. 12
        put_six(out, Z, -c.c_z * max(-L * dilatancy, 0.0) * (c.z_max * n + z))  # Eq. 27
        return FINE
