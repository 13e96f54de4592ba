"""Love's stress, and scalar measures of a stress tensor."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from labkit.micro.tensors import COMPONENTS, symmetric, to_six


def stress_of_forces(branch: np.ndarray, force: np.ndarray, volume: float) -> np.ndarray:
    """Return Love's stress sigma = -(1/V) sum of b (x) f (Eq. 4), (3, 3), in Pa, compression positive.

    Args:
        branch: Vectors b from the first to the second grain, (n, 3), in m.
        force: Forces f on the first grain, (n, 3), in N.
        volume: Volume V of the cell (m3).
    """
    return -(branch.T @ force) / volume


def branch_force(branch: Iterable[float], force: Iterable[float]) -> tuple[float, ...]:
    """Return the products b_i f_j of one contact (N m) in the order xx, xy, ... zz; engines compile this function."""
    (a, b, c), (x, y, z) = branch, force
    return a * x, a * y, a * z, b * x, b * y, b * z, c * x, c * y, c * z


def mean_stress(stress: np.ndarray) -> np.ndarray:
    """Return the mean stress p = tr(sigma)/3 of a stress (..., 3, 3), in Pa."""
    return np.trace(stress, axis1=-2, axis2=-1) / 3.0


def deviatoric_stress(stress: np.ndarray) -> np.ndarray:
    """Return the deviatoric stress q = sigma_zz - (sigma_xx + sigma_yy)/2 (Pa); negative in triaxial extension.

    In triaxial compression q is the paper's sigma_1 - sigma_3. `stress` has the shape (..., 3, 3), in Pa.
    """
    return stress[..., 2, 2] - 0.5 * (stress[..., 0, 0] + stress[..., 1, 1])


def deviator(tensor: np.ndarray) -> np.ndarray:
    """Return the symmetric deviatoric part of a tensor (..., 3, 3)."""
    part = symmetric(tensor)
    return part - np.trace(part, axis1=-2, axis2=-1)[..., None, None] / 3.0 * np.eye(3)


def equivalent_stress(stress: np.ndarray) -> np.ndarray:
    """Return the invariant q = sqrt(3/2 s:s) >= 0 (Pa) of a stress (..., 3, 3), in Pa, with the deviator s.

    In triaxial compression q is sigma_1 - sigma_3. In simple shear with equal normal stresses q is sqrt(3) |sigma_xz|.
    """
    return np.sqrt(1.5) * np.linalg.norm(deviator(stress), axis=(-2, -1))


def largest_deviation(stress: np.ndarray, pressure: float) -> tuple[str, float]:
    """Return the component, e.g. "xz", in which a stress is farthest from isotropic, and the difference (Pa).

    Args:
        stress: Stress, (3, 3), in Pa.
        pressure: Pressure of the isotropic stress (Pa).
    """
    off = np.abs(to_six(symmetric(stress) - pressure * np.eye(3)) / to_six(np.ones((3, 3))))
    worst = int(off.argmax())
    return COMPONENTS[worst], float(off[worst])


def q_of_test(stress: np.ndarray, axisymmetric: bool) -> np.ndarray:
    """Return q of a test (Pa): signed in a test that is axisymmetric about z, otherwise the invariant sqrt(3/2 s:s)."""
    return deviatoric_stress(stress) if axisymmetric else equivalent_stress(stress)


def principal_stresses(stress: np.ndarray) -> np.ndarray:
    """Return the principal stresses in ascending order, (..., 3), Pa; NaN where a stress (..., 3, 3) is not finite."""
    both = symmetric(stress)
    finite = np.isfinite(both).all(axis=(-2, -1))[..., None]
    return np.where(finite, np.linalg.eigvalsh(np.where(finite[..., None], both, 0.0)), np.nan)


def intermediate_ratio(stress: np.ndarray) -> np.ndarray:
    """Return b = (sigma_2 - sigma_3)/(sigma_1 - sigma_3) of a stress (..., 3, 3); NaN where it is isotropic."""
    third, second, largest = np.moveaxis(principal_stresses(stress), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (second - third) / (largest - third)


def lode_angle(stress: np.ndarray) -> np.ndarray:
    """Return the Lode angle of a stress (..., 3, 3) in degrees: 0 in triaxial compression, 60 in triaxial extension.

    tan(theta) = sqrt(3) b/(2 - b); NaN where the stress is isotropic.
    """
    b = intermediate_ratio(stress)
    return np.degrees(np.arctan2(np.sqrt(3.0) * b, 2.0 - b))


def along_deviator(tensor: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Return the component 3/2 s:T/q of a tensor T along the stress deviator s, (...); NaN for an isotropic stress.

    In triaxial compression the component is T_zz - (T_xx + T_yy)/2; the component of the stress itself is q. Both
    arguments have the shape (..., 3, 3).
    """
    s = deviator(stress)
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.5 * np.einsum("...ij,...ij->...", s, symmetric(tensor)) / equivalent_stress(stress)


def relative_error(stress: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return |stress - reference|/|reference| with the Frobenius norm, shape (...); 0/0 is NaN."""
    difference = np.linalg.norm(np.asarray(stress) - reference, axis=(-2, -1))
    norm = np.linalg.norm(reference, axis=(-2, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return difference / norm
