"""The modified stress-force-fabric relationship C0."""

from __future__ import annotations

import numpy as np

IDENTITY = np.eye(3)


def symmetric_product(F, A):
    """sym(FA) = (FA + AF)/2. The paper prints FA, which is symmetric only for coaxial tensors.

    Shapes (..., 3, 3).
    """
    return 0.5 * (F @ A + A @ F)


def sff_stress(young_modulus, Z, Lam, e, A, F, Ft):
    """sigma = E Z Lam/(1+e) [I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t]   (C0)

    `e` is the nominal void ratio, V/V_g - 1. Z, Lam, e (...); A, F, Ft (..., 3, 3); the stress has shape
    (..., 3, 3), Pa, compression positive. It is zero where Z Lam = 0, whatever the tensors.
    """
    Z, Lam, e = (np.asarray(x, dtype=float)[..., None, None] for x in (Z, Lam, e))
    A, F, Ft = (np.asarray(x, dtype=float) for x in (A, F, Ft))
    FA = symmetric_product(F, A)
    trace = np.trace(FA, axis1=-2, axis2=-1)[..., None, None]
    bracket = (
        IDENTITY / 3 + 2 / 15 * A + 2 / 15 * F + 2 / 105 * trace * IDENTITY + 8 / 105 * FA + Ft
    )
    scale = young_modulus * Z * Lam / (1.0 + e)
    return np.where(scale == 0.0, 0.0, scale * bracket)


TERMS = ("A", "F", "Ft", "coupled")


def strength_shares(A, F, Ft):
    """What each term of C0 adds to q/p: name of TERMS -> shape (...), q = sigma_zz - (sigma_xx + sigma_yy)/2.

    2/15 A, 2/15 F, F^t and 8/105 sym(FA), over the mean stress of the bracket, 1/3 + 2/45 tr(FA): they add up
    to the q/p of C0. A, F, Ft (..., 3, 3); NaN where these are undefined.
    """
    FA = symmetric_product(np.asarray(F), np.asarray(A))
    trace = np.trace(FA, axis1=-2, axis2=-1)
    mean = 1 / 3 + 2 / 105 * trace + 8 / 315 * trace + np.trace(Ft, axis1=-2, axis2=-1) / 3
    parts = dict(zip(TERMS, (2 / 15 * np.asarray(A), 2 / 15 * np.asarray(F), np.asarray(Ft), 8 / 105 * FA)))
    return {name: (part[..., 2, 2] - 0.5 * (part[..., 0, 0] + part[..., 1, 1])) / mean for name, part in parts.items()}
