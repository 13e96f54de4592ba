"""Love's stress (Eq. 4) and scalar measures of a stress tensor."""

from __future__ import annotations

import numpy as np

from labkit.micro.snapshot import Snapshot


def love_stress(snapshot: Snapshot) -> np.ndarray:
    """Love's stress sigma = -(1/V) sum of l (x) f over all contact sides, with l = (R - delta/2) n (Eq. 4).

    On the two sides of a contact both n and f are opposite, so that the two terms add up to the branch vector times the
    force. Shape (3, 3), Pa, compression positive, first index: branch vector; zero without contacts.
    """
    contacts = snapshot.contacts
    weighted_normal = contacts.branch_length(snapshot.radius)[:, None] * contacts.normal
    return -(weighted_normal.T @ contacts.force_on_first()) / snapshot.volume


def mean_stress(stress: np.ndarray) -> np.ndarray:
    """Mean stress p = tr(sigma)/3, Pa. `stress` (..., 3, 3) Pa; shape (...)."""
    return np.trace(stress, axis1=-2, axis2=-1) / 3.0


def deviatoric_stress(stress: np.ndarray) -> np.ndarray:
    """Deviatoric stress q = sigma_zz - (sigma_xx + sigma_yy)/2, Pa; negative in triaxial extension.

    In triaxial compression this is the paper's sigma_1 - sigma_3. `stress` (..., 3, 3) Pa; shape (...).
    """
    return stress[..., 2, 2] - 0.5 * (stress[..., 0, 0] + stress[..., 1, 1])


def relative_error(stress: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Frobenius norm of the difference, divided by the norm of the reference, shape (...); 0/0 is NaN."""
    difference = np.linalg.norm(np.asarray(stress) - reference, axis=(-2, -1))
    norm = np.linalg.norm(reference, axis=(-2, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return difference / norm
