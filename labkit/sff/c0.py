"""C0, the modified stress-force-fabric relationship of the paper: it follows from Eqs. 19-27 and stands before Eq. 28.

    sigma = E Z Lambda/(1+e) [I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t]   (C0)

Eqs. 19-21 are the stress with the normalised contact force Lambda, Eq. 22 splits it into a normal and a tangential
part, and Eqs. 23-27 are the fits that C0 puts in. Eqs. 28-30 are C0 without the product of A and F.
"""

from __future__ import annotations

import numpy as np

from labkit.micro.fabric import statistics
from labkit.micro.snapshot import Snapshot
from labkit.micro.void_ratio import void_ratio_nominal

IDENTITY = np.eye(3)


def symmetric_product(F: np.ndarray, A: np.ndarray) -> np.ndarray:
    """sym(FA) = (FA + AF)/2. The paper prints FA, which is symmetric only for coaxial tensors.

    Shapes (..., 3, 3).
    """
    return 0.5 * (F @ A + A @ F)


def bracket(
    delta: np.ndarray, A: np.ndarray, F: np.ndarray, trace_FA: np.ndarray, FA: np.ndarray, Ft: np.ndarray
) -> np.ndarray:
    """I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t, the bracket of C0, component by component.

    `delta`: of the identity; `FA`: of sym(FA); `trace_FA`: tr(FA). Arrays of any shape that numpy broadcasts, or the
    numbers of one component: labkit.model.equations compiles it for these.
    """
    return delta / 3 + 2 / 15 * A + 2 / 15 * F + 2 / 105 * trace_FA * delta + 8 / 105 * FA + Ft


def c0_stress(
    young_modulus: float, Z: np.ndarray, Lam: np.ndarray, e: np.ndarray, A: np.ndarray, F: np.ndarray, Ft: np.ndarray
) -> np.ndarray:
    """sigma = E Z Lam/(1+e) [I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t]   (C0)

    `young_modulus` E, Pa; `e` is the nominal void ratio, V/V_g - 1. Z, Lam, e (...); A, F, Ft (..., 3, 3); the stress
    has shape (..., 3, 3), Pa, compression positive. It is zero where Z Lam = 0, whatever the tensors.
    """
    Z, Lam, e = (np.asarray(x, dtype=float)[..., None, None] for x in (Z, Lam, e))
    A, F, Ft = (np.asarray(x, dtype=float) for x in (A, F, Ft))
    FA = symmetric_product(F, A)
    trace = np.trace(FA, axis1=-2, axis2=-1)[..., None, None]
    scale = young_modulus * Z * Lam / (1.0 + e)
    return np.where(scale == 0.0, 0.0, scale * bracket(IDENTITY, A, F, trace, FA, Ft))


def sff_stress(snapshot: Snapshot) -> np.ndarray:
    """The stress that C0 predicts from the five statistics of a snapshot, shape (3, 3), Pa, compression positive.

    Zero without contacts. Love's stress of the same contacts is labkit.micro.stress.love_stress.
    """
    if len(snapshot.contacts) == 0:
        return np.zeros((3, 3))
    found = statistics(snapshot)
    return c0_stress(
        snapshot.young_modulus,
        found.coordination_number,
        found.mean_normalised_force,
        void_ratio_nominal(snapshot),
        found.contact_anisotropy,
        found.normal_force_anisotropy,
        found.mobilisation,
    )


TERMS = ("A", "F", "Ft", "coupled")


def strength_shares(A: np.ndarray, F: np.ndarray, Ft: np.ndarray) -> dict[str, np.ndarray]:
    """What each term of C0 adds to q/p: name of TERMS -> shape (...), q = sigma_zz - (sigma_xx + sigma_yy)/2.

    2/15 A, 2/15 F, F^t and 8/105 sym(FA), over the mean stress of the bracket, 1/3 + 2/45 tr(FA): they add up
    to the q/p of C0. A, F, Ft (..., 3, 3); NaN where these are undefined.
    """
    FA = symmetric_product(np.asarray(F), np.asarray(A))
    trace = np.trace(FA, axis1=-2, axis2=-1)
    mean = 1 / 3 + 2 / 105 * trace + 8 / 315 * trace + np.trace(Ft, axis1=-2, axis2=-1) / 3
    parts = dict(
        zip(TERMS, (2 / 15 * np.asarray(A), 2 / 15 * np.asarray(F), np.asarray(Ft), 8 / 105 * FA), strict=True)
    )
    return {name: (part[..., 2, 2] - 0.5 * (part[..., 0, 0] + part[..., 1, 1])) / mean for name, part in parts.items()}
