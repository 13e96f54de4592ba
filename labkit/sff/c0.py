"""C0, the paper's modified stress-force-fabric equation, derived from Eqs. 19-27 and printed before Eq. 28.

    sigma = E Z Lambda/(1+e) [I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t]   (C0)

For grains that are not spheres the bracket also contains M - X, the two terms of labkit.micro.eccentricity.

Eqs. 19-21 express the stress in terms of the normalised contact force Lambda, Eq. 22 splits it into a normal and a
tangential part, and Eqs. 23-27 are the fits that are inserted to obtain C0. Eqs. 28-30 are C0 without the
product of A and F.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from labkit.micro.fabric import Statistics, statistics, statistics_by_volume
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import along_deviator
from labkit.micro.void_ratio import void_ratio_nominal

IDENTITY = np.eye(3)
Values = np.ndarray | float


def symmetric_product(F: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Return the symmetric product sym(FA) = (FA + AF)/2, shapes (..., 3, 3).

    The paper prints FA, which is symmetric only for coaxial tensors.
    """
    return 0.5 * (F @ A + A @ F)


def bracket(delta: Values, A: Values, F: Values, trace_FA: Values, FA: Values, Ft: Values) -> Any:
    """Return the bracket of C0, I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t, component by component.

    The arguments are arrays that broadcast, or scalars for a single component. labkit.model.equations compiles this
    function for scalars.

    Args:
        delta: Component of the identity.
        A: Component of A.
        F: Component of F.
        trace_FA: tr(FA).
        FA: Component of sym(FA).
        Ft: Component of F^t.
    """
    return delta / 3 + 2 / 15 * A + 2 / 15 * F + 2 / 105 * trace_FA * delta + 8 / 105 * FA + Ft


def c0_stress(
    young_modulus: float,
    Z: Values,
    Lam: Values,
    e: Values,
    A: np.ndarray,
    F: np.ndarray,
    Ft: np.ndarray,
    eccentricity: np.ndarray | None = None,
) -> np.ndarray:
    """Return the stress that C0 predicts from five statistics, shape (..., 3, 3), in Pa, compression positive.

    sigma = E Z Lam/(1+e) [I/3 + 2/15 A + 2/15 F + 2/105 tr(FA) I + 8/105 sym(FA) + F^t + M - X]   (C0; M = X = 0 for
    spheres, as in the paper)

    The stress is zero where Z Lam = 0, even if the tensors are NaN.

    Args:
        young_modulus: E (Pa).
        Z: Coordination number, (...).
        Lam: Mean normalised force Lambda, (...).
        e: Nominal void ratio, V/V_g - 1, (...).
        A: Contact anisotropy, (..., 3, 3).
        F: Anisotropy of the normal force, (..., 3, 3).
        Ft: Mobilisation F^t, (..., 3, 3).
        eccentricity: M - X (labkit.micro.eccentricity), (..., 3, 3), for grains that are not spheres.
    """
    Z, Lam, e = (np.asarray(x, dtype=float)[..., None, None] for x in (Z, Lam, e))
    A, F, Ft = (np.asarray(x, dtype=float) for x in (A, F, Ft))
    FA = symmetric_product(F, A)
    trace = np.trace(FA, axis1=-2, axis2=-1)[..., None, None]
    scale = young_modulus * Z * Lam / (1.0 + e)
    inside = bracket(IDENTITY, A, F, trace, FA, Ft)
    return np.where(scale == 0.0, 0.0, scale * (inside if eccentricity is None else inside + eccentricity))


def sff_stress(snapshot: Snapshot, fabric: Statistics | None = None) -> np.ndarray:
    """Return the stress that C0 predicts from a snapshot, shape (3, 3), in Pa, compression positive.

    For spheres this is C0 as the paper prints it, which takes the stress of grains of all sizes as equal: for wide
    gradings use `sff_stress_by_volume`. For clumps it includes the terms M - X of eccentric contacts. The stress is
    zero without contacts. labkit.love_stress returns Love's stress of the same contacts.

    Args:
        snapshot: The snapshot.
        fabric: labkit.statistics(snapshot), if already computed.
    """
    return _c0_of(snapshot, fabric or statistics(snapshot))


def sff_stress_by_volume(snapshot: Snapshot, fabric: Statistics | None = None) -> np.ndarray:
    """Return the stress by the equation by volume, C0 with l f over the mean grain volume, (3, 3), in Pa.

    Its mean stress is that of Love for grains of any sizes and shapes; what its deviator assumes is in docs/theory.md.
    Otherwise it is as `sff_stress`.

    Args:
        snapshot: The snapshot.
        fabric: labkit.micro.statistics_by_volume(snapshot), if already computed.
    """
    return _c0_of(snapshot, fabric or statistics_by_volume(snapshot))


def _c0_of(snapshot, fabric):
    """Return C0 of a snapshot with these Statistics, (3, 3), Pa."""
    return c0_stress(
        snapshot.young_modulus,
        fabric.coordination_number,
        fabric.mean_normalised_force,
        void_ratio_nominal(snapshot),
        fabric.contact_anisotropy,
        fabric.normal_force_anisotropy,
        fabric.mobilisation,
        fabric.eccentricity,
    )


TERMS = ("A", "F", "Ft", "coupled")
ECCENTRIC_TERMS = ("M", "-X")  # further terms of grains that are not spheres


def strength_shares(
    A: np.ndarray,
    F: np.ndarray,
    Ft: np.ndarray,
    axisymmetric: bool = True,
    eccentric: tuple[np.ndarray, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return the contribution of each term of C0 to q/p, name in TERMS -> shape (...).

    The terms 2/15 A, 2/15 F, F^t, 8/105 sym(FA), and for grains that are not spheres M and -X, are divided by the mean
    stress of the bracket, 1/3 + 2/45 tr(FA) + tr(F^t + M - X)/3, and add up to the q/p of C0. The result is NaN where
    the tensors are NaN.

    Args:
        A: Contact anisotropy, (..., 3, 3).
        F: Anisotropy of the normal force, (..., 3, 3).
        Ft: Mobilisation F^t, (..., 3, 3).
        axisymmetric: True for q = sigma_zz - (sigma_xx + sigma_yy)/2; False for the invariant sqrt(3/2 s:s), to which a
            term contributes its component along the stress deviator s.
        eccentric: M and X, each (..., 3, 3), for grains that are not spheres; the result then includes ECCENTRIC_TERMS.
    """
    FA = symmetric_product(np.asarray(F), np.asarray(A))
    trace = np.trace(FA, axis1=-2, axis2=-1)
    mean = 1 / 3 + 2 / 105 * trace + 8 / 315 * trace + np.trace(Ft, axis1=-2, axis2=-1) / 3
    parts = dict(
        zip(TERMS, (2 / 15 * np.asarray(A), 2 / 15 * np.asarray(F), np.asarray(Ft), 8 / 105 * FA), strict=True)
    )
    if eccentric is not None:
        of_shape = dict(zip(ECCENTRIC_TERMS, (eccentric[0], -eccentric[1]), strict=True))
        parts |= of_shape
        mean = mean + sum(np.trace(part, axis1=-2, axis2=-1) for part in of_shape.values()) / 3
    if not axisymmetric:
        deviator = np.sum(list(parts.values()), axis=0)
        return {name: along_deviator(part, deviator) / mean for name, part in parts.items()}
    return {name: (part[..., 2, 2] - 0.5 * (part[..., 0, 0] + part[..., 1, 1])) / mean for name, part in parts.items()}
