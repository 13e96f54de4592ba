"""Fabric of contacts (Z, A) and normalised contact forces (Lambda, F, F^t): Eqs. 10 and 23-27."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.normalised import vectors_of_contacts

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


def contact_anisotropy(normal):
    """A = 15/2 (<n n> - I/3) (Eq. 10), shape (3, 3). `normal` (n, 3) unit vectors; NaN for n = 0."""
    if len(normal) == 0:
        return np.full((3, 3), np.nan)
    return 7.5 * (normal.T @ normal / len(normal) - IDENTITY / 3.0)


def statistics(contacts, radius, young_modulus):
    """Z, A, Lambda, F and F^t of a set of contacts (Eqs. 10, 24, 25, 27).

    `radius` (grain,) m of all grains, those without contacts included; `young_modulus` E in Pa.
    """
    if len(contacts) == 0:
        nothing = np.full((3, 3), np.nan)
        return Statistics(0.0, nothing, 0.0, nothing, nothing)
    A, Lam, F, Ft = fabric_of(vectors_of_contacts(radius, contacts, young_modulus))
    return Statistics(2 * len(contacts) / len(radius), A, Lam, F, Ft)


def fabric_of(vectors):
    """A, Lambda, F, F^t of Vectors (Eqs. 10, 24, 25, 27); not for an empty set."""
    n, rows = vectors.normal, len(vectors)
    A = contact_anisotropy(n)
    density = 1.0 + np.einsum("ci,ci->c", n @ A, n)  # 1 + n.A n
    with np.errstate(divide="ignore", invalid="ignore"):
        Lambda_n = vectors.normal_component / density
        Lambda_t = vectors.tangential / density[:, None]
        Lam = Lambda_n.sum() / rows  # Eq. 24
        F = 7.5 * ((n * Lambda_n[:, None]).T @ n / rows / Lam - IDENTITY / 3.0)  # Eq. 25
        Ft = -(n.T @ Lambda_t) / rows / Lam  # Eq. 27
    return A, float(Lam), F, Ft
