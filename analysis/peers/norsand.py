"""NorSand: critical state plasticity whose yield surface hardens towards a size that the state parameter limits.

Jefferies, Nor-Sand: a simple critical state model for sand, Geotechnique 43 (1993) 91-103; the equations follow
Jefferies and Shuttle, On the operating critical friction ratio in general stress states, Geotechnique 61 (2011)
709-713, and Jefferies and Been, Soil liquefaction, second edition, 2015, appendix C. Plastic strain increments have the
direction of s in the deviatoric plane.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from analysis.peers.invariants import ATMOSPHERE, HOLD, ON_SURFACE, cos_three_theta, cos_three_theta_slope, direction_of
from labkit.model.law import INTERNAL, STRESS, RateLaw
from labkit.model.rates import FINE, OUTSIDE
from labkit.model.tensors import IDENTITY, Six, contract, deviatoric_part, elastic_stress, norm, put_six, six_at, trace

LEAST = 1e-6  # below this stress ratio the strain rate sets the loading direction


def critical_ratio(x: float, c: Any) -> tuple[float, float]:
    """(M, dM/dx), M = M_tc (1 - M_tc/(3 + M_tc) cos(3 theta/2 + pi/4)); x = sin(3 theta), 1 in compression.

    In compression M has a corner, at which its slope would be infinite; this function bounds the slope.
    """
    range_of = c.M_tc**2 / (3.0 + c.M_tc)
    return c.M_tc - range_of * np.sqrt(0.5 * (1.0 - x)), 0.25 * range_of / np.sqrt(0.5 * max(1.0 - x, 1e-6))


def image_ratio(e: float, p_i: float, M: float, c: Any) -> tuple[float, float, float]:
    """Critical ratio M_i, state parameter psi_i = e - e_c(p_i) and dilatancy parameter chi_i at the image state."""
    chi_i = c.chi / (1.0 - c.lambda_c * c.chi / c.M_tc)
    psi_i = e - (c.Gamma - c.lambda_c * np.log(p_i / 1e3))
    return M * (1.0 - c.N * chi_i * abs(psi_i) / c.M_tc), psi_i, chi_i


class NorSand(RateLaw):
    """NorSand (Jefferies 1993, in general stress states Jefferies and Shuttle 2011).

    Parameters: Gamma, lambda_c (critical state line Gamma - lambda_c ln(p/kPa)); M_tc, N, chi (stress ratio and
    dilatancy); H0, H_y (hardening H = H0 - H_y psi); G_ref (Pa), n, nu (elasticity, G = G_ref (p/p_at)^n). The initial
    state is on the yield surface.
    """

    name = "norsand"
    parameters: ClassVar = {
        "Gamma": (0.9, 0.1, 3.0),
        "lambda_c": (0.02, 1e-4, 0.5),
        "M_tc": (1.2, 0.1, 2.5),
        "N": (0.3, 0.0, 1.0),
        "chi": (3.5, 0.0, 20.0),
        "H0": (300.0, 1.0, 1e5),
        "H_y": (50.0, -1e5, 1e5),
        "G_ref": (40e6, 1e5, 1e12),
        "n": (0.5, 0.0, 2.0),
        "nu": (0.15, 0.0, 0.49),
    }
    internal: ClassVar = {"image_pressure": (1, 1e5)}

    def begin(self, y: np.ndarray) -> None:
        sigma, c = six_at(y[STRESS:INTERNAL], 0), self.constants
        s, p = deviatoric_part(sigma), trace(sigma) / 3.0
        M, _ = critical_ratio(cos_three_theta(s), c)
        low, high = p * np.exp(-2.0), p * np.exp(20.0)
        for _ in range(200):
            y[INTERNAL] = np.sqrt(low * high)
            image_M, _, _ = image_ratio(y[0], y[INTERNAL], M, c)
            inside = np.sqrt(1.5) * norm(s) / p < image_M * (1.0 + np.log(y[INTERNAL] / p))
            low, high = (low, y[INTERNAL]) if inside else (y[INTERNAL], high)

    @staticmethod
    def rates(y: np.ndarray, D: Six, compressing: bool, c: Any, out: np.ndarray) -> int:
        sigma, e, p_i = six_at(y, STRESS), y[0], y[INTERNAL]
        p = trace(sigma) / 3.0
        if not (p > 0.0 and p_i > 0.0):
            return OUTSIDE
        G = c.G_ref * (p / ATMOSPHERE) ** c.n
        K = G * 2.0 * (1.0 + c.nu) / (3.0 * (1.0 - 2.0 * c.nu))
        out[:] = 0.0
        out[0] = -(1.0 + e) * trace(D)
        elastic = elastic_stress(G, K, D)
        put_six(out, STRESS, elastic)
        s = deviatoric_part(sigma)
        u = direction_of(s, D, LEAST * p)
        ratio = np.sqrt(1.5) * norm(s) / p
        x = cos_three_theta(u)
        M, slope = critical_ratio(x, c)
        image_M, psi_i, chi_i = image_ratio(e, p_i, M, c)
        size = 1.0 + np.log(p_i / p)
        f = ratio - image_M * size
        by_image = size * M / c.M_tc * c.N * chi_i * np.sign(psi_i)  # df/dpsi_i
        normal = np.sqrt(1.5) * u  # p df/dsigma
        if ratio > LEAST:
            normal = normal - np.sqrt(1.5) / ratio * size * image_M / M * slope * cos_three_theta_slope(u)
        normal = normal + (image_M - ratio) / 3.0 * IDENTITY
        pushed = contract(normal, elastic) + p * by_image * out[0]
        if f < -ON_SURFACE or pushed <= 0.0:
            return FINE
        limit_M = c.M_tc - c.N * chi_i * abs(psi_i)
        psi = e - (c.Gamma - c.lambda_c * np.log(p / 1e3))
        most = p * np.exp(-chi_i * psi_i / limit_M)
        # rate of p_i per deviatoric plastic strain
        hardening = (c.H0 - c.H_y * psi) * image_M / limit_M * p / p_i * (most - p_i)
        plastic = 2.0 * G * np.sqrt(1.5) * u + K * (image_M - ratio) * IDENTITY
        resistance = contract(normal, plastic) + p * hardening / p_i * (image_M - by_image * c.lambda_c)
        L = (pushed + HOLD * p * f * norm(D)) / resistance
        if resistance <= 0.0:
            return OUTSIDE
        put_six(out, STRESS, elastic - L * plastic)
        out[INTERNAL] = L * hardening
        return FINE
