"""Fabric of contacts (Z, A) and normalised contact forces (Lambda, F, F^t): Eqs. 10 and 23-27."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.contacts import grain_diameters

IDENTITY = np.eye(3)


@dataclasses.dataclass(frozen=True)
class Statistics:
    """The state variables of C0. Without contacts Z and Lambda are 0 and the tensors are NaN (undefined).

    coordination_number: Z = Nc/Ng, both sides counted;
    contact_anisotropy (3, 3): A, Eq. 10;
    mean_normalised_force: Lambda, Eq. 24;
    normal_force_anisotropy (3, 3): F, Eq. 25;
    mobilisation (3, 3): F^t, Eq. 27.
    """

    coordination_number: float
    contact_anisotropy: np.ndarray
    mean_normalised_force: float
    normal_force_anisotropy: np.ndarray
    mobilisation: np.ndarray


def overlap_correction(radius, contacts):
    """lambda' = 1 - delta/D of the contact vector l = lambda' (D/2) n (below Eq. 18), shape (n, 2)."""
    return 1.0 - contacts.overlap[:, None] / grain_diameters(radius, contacts)


def normalisation(radius, contacts, young_modulus):
    """Lambda/f = 3 lambda'/(pi D^2 E) of each side (below Eq. 18), shape (n, 2), 1/N."""
    diameter = grain_diameters(radius, contacts)
    return 3.0 * overlap_correction(radius, contacts) / (np.pi * diameter**2 * young_modulus)


def contact_anisotropy(normal):
    """A = 15/2 (<n n> - I/3) (Eq. 10), shape (3, 3). `normal` (n, 3) unit vectors; NaN for n = 0."""
    if len(normal) == 0:
        return np.full((3, 3), np.nan)
    return 7.5 * (normal.T @ normal / len(normal) - IDENTITY / 3.0)


def statistics(contacts, radius, young_modulus):
    """Z, A, Lambda, F and F^t of a set of contacts (Eqs. 10, 24, 25, 27).

    `radius` (grain,) m of all grains, those without contacts included; `young_modulus` E in Pa.
    """
    sides = 2 * len(contacts)
    if sides == 0:
        nothing = np.full((3, 3), np.nan)
        return Statistics(0.0, nothing, 0.0, nothing, nothing)
    normal = contacts.normal
    A = contact_anisotropy(normal)
    weight = normalisation(radius, contacts, young_modulus).sum(axis=1)
    density = 1.0 + np.einsum("ci,ci->c", normal @ A, normal)  # 1 + n.A n
    with np.errstate(divide="ignore", invalid="ignore"):
        Lambda_n = weight * contacts.normal_force / density
        Lambda_t = (weight / density)[:, None] * contacts.tangential_force
        Lam = Lambda_n.sum() / sides  # Eq. 24
        F = 7.5 * ((normal * Lambda_n[:, None]).T @ normal / sides / Lam - IDENTITY / 3.0)  # Eq. 25
        Ft = -(normal.T @ Lambda_t) / sides / Lam  # Eq. 27
    return Statistics(sides / len(radius), A, float(Lam), F, Ft)
