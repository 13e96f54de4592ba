"""Contact fabric (Z, A) and normalised contact force (Lambda, F, F^t): Eqs. 10 and 23-27."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.contacts import contacts_of
from labkit.micro.directions import DirectionalFit, directional_fit, normal_density
from labkit.micro.normalised import Vectors, vectors_of_contacts
from labkit.micro.snapshot import Snapshot


@dataclasses.dataclass(frozen=True)
class Statistics:
    """State variables of C0. Without contacts, Z and Lambda are 0 and the tensors are NaN (undefined).

    Args:
        coordination_number: Z = Nc/Ng, each contact counted on both sides.
        contact_anisotropy: A, Eq. 10, (3, 3).
        mean_normalised_force: Lambda, Eq. 24.
        normal_force_anisotropy: F, Eq. 25, (3, 3).
        mobilisation: F^t, Eq. 27, (3, 3).
    """

    coordination_number: float
    contact_anisotropy: np.ndarray
    mean_normalised_force: float
    normal_force_anisotropy: np.ndarray
    mobilisation: np.ndarray

    def __str__(self) -> str:
        tensors = self.contact_anisotropy, self.normal_force_anisotropy, self.mobilisation
        rows = ["".join(f"{'':4}" + "".join(f"{x:8.4f}" for x in one[i]) for one in tensors) for i in range(3)]
        names = "".join(f"{name:>14}{'':14}" for name in ("A", "F", "F^t")).rstrip()
        scalars = f"Z = {self.coordination_number:.4g}, Lambda = {self.mean_normalised_force:.4g}"
        return "\n".join([scalars, names, *rows])


@dataclasses.dataclass(frozen=True)
class Series:
    """Directional functions of a set of Vectors: E_PDF, mean Lambda_n, and F^t.

    Args:
        density: Fit of E_PDF(n), whose second-order tensor is A.
        normal_force: Fit of the mean of Lambda_n in the direction n, whose mean is Lambda and whose second-order
            tensor is F.
        mobilisation: F^t of Eq. 27, weighted with `density`, (3, 3).
    """

    density: DirectionalFit
    normal_force: DirectionalFit
    mobilisation: np.ndarray


def series_of(vectors: Vectors, order: int = 2, density: DirectionalFit | None = None) -> Series:
    """Return the Series of a non-empty set of Vectors.

    Args:
        vectors: The Vectors.
        order: Order of E_PDF and Lambda_n, 2 (Eqs. 10, 24, 25, 27) or 4.
        density: E_PDF, if the vectors are only a part of those that determine it.
    """
    n = vectors.normal
    density = density or normal_density(n, order)
    with np.errstate(divide="ignore", invalid="ignore"):
        shape = density.shape(n)  # 1 + n.A n + ...
        normal_force = directional_fit(n, vectors.normal_component / shape, order)  # Eqs. 24, 25
        mobilisation = -(n.T @ (vectors.tangential / shape[:, None])) / len(n) / normal_force.mean  # Eq. 27
    return Series(density, normal_force, mobilisation)


def contact_anisotropy(normal: np.ndarray) -> np.ndarray:
    """Contact anisotropy A = 15/2 (<n n> - I/3) (Eq. 10), (3, 3), of unit vectors (n, 3); NaN for n = 0."""
    return normal_density(normal).second


def statistics(snapshot: Snapshot) -> Statistics:
    """State variables of C0 in a snapshot: Z, A, Lambda, F and F^t (Eqs. 10, 24, 25, 27)."""
    contacts = contacts_of(snapshot)
    if len(contacts) == 0:
        undefined = np.full((3, 3), np.nan)
        return Statistics(0.0, undefined, 0.0, undefined, undefined)
    series = series_of(vectors_of_contacts(snapshot))
    force = series.normal_force
    Z = 2 * len(contacts) / snapshot.number_of_grains
    return Statistics(Z, series.density.second, force.mean, force.second, series.mobilisation)
