"""Contact fabric and normalised contact force, as directional functions: Eqs. 9-11 and 23-27, the statistics of C0.

An even function of the direction n is written f(n) = f0 [1 + n.B n + B4::nnnn] with B deviatoric and B4 symmetric
and traceless (Kanatani's tensors of the third kind). For the density of contact normals f0 = 1/(4 pi), B = A.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from labkit.errors import InputError
from labkit.micro.contact_sides import Vectors, mean_volume, vectors_of_contacts
from labkit.micro.eccentricity import contact_eccentricity
from labkit.micro.snapshot import Snapshot, contacts_of

IDENTITY = np.eye(3)
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
_PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # index of the pair ij in a row of six products


def _symmetric_with_identity(B):
    """Return the part of I (x) B that is symmetric in all four indices, (3, 3, 3, 3), for symmetric B (3, 3)."""
    both = np.einsum("ij,kl->ijkl", IDENTITY, B) + np.einsum("ij,kl->ijkl", B, IDENTITY)
    return (both + both.transpose(0, 2, 1, 3) + both.transpose(0, 3, 2, 1)) / 6.0


_IDENTITY4 = _symmetric_with_identity(IDENTITY)


def traceless(S: np.ndarray) -> np.ndarray:
    """Return the traceless part of a fully symmetric S (3, 3, 3, 3): S - 6/7 sym(I S_iikl) + 3/35 S_iikk sym(I I)."""
    second = np.einsum("iikl->kl", S)
    return S - 6.0 / 7.0 * _symmetric_with_identity(second) + 3.0 / 35.0 * np.trace(second) * _IDENTITY4


@dataclasses.dataclass(frozen=True, eq=False)
class DirectionalFit:
    """A fitted directional function f0 [1 + n.B n + B4::nnnn].

    Args:
        mean: f0.
        second: B, (3, 3).
        fourth: B4, (3, 3, 3, 3), zero for a fit of second order.
    """

    mean: float
    second: np.ndarray
    fourth: np.ndarray

    def at(self, n: np.ndarray) -> np.ndarray:
        """Return the values f0 [1 + n.B n + B4::nnnn] at unit vectors n (m, 3), shape (m,)."""
        return self.mean * self.shape(n)

    def shape(self, n: np.ndarray) -> np.ndarray:
        """Return the values 1 + n.B n + B4::nnnn at unit vectors n (m, 3), shape (m,)."""
        value = 1.0 + np.einsum("mi,mi->m", n @ self.second, n)
        if self.fourth.any():
            products = _products(n)
            half = np.einsum("ma,ab->mb", products, _as_matrix(self.fourth))  # einsum avoids the threads of BLAS
            value = value + np.einsum("ma,ma->m", half, products)
        return value


def directional_fit(n: np.ndarray, values: np.ndarray, order: int = 2) -> DirectionalFit:
    """Fit a directional function that has the same moments, up to `order`, as the values v in the directions n.

    f0 = <v>, B = 15/2 (<v nn>/f0 - I/3), B4 = 315/8 times the traceless part of <v nnnn>/f0

    <> is the mean over the m rows of `n` (m, 3), unit vectors, and `values` (m,). With v = 1 the result is the density
    of contact normals divided by 1/(4 pi) (Eqs. 9, 10); with v = Lambda_n/(1 + n.A n) it is the mean of Lambda_n in the
    direction n (Eqs. 23-25). All NaN for m = 0 or f0 = 0. Raises InputError for an order other than 2 or 4.
    """
    if order not in (2, 4):
        raise InputError(field="order", value=order, allowed="2 or 4")
    zero4 = np.zeros((3, 3, 3, 3))
    if len(n) == 0:
        return DirectionalFit(np.nan, np.full((3, 3), np.nan), zero4 * np.nan if order == 4 else zero4)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = float(values.mean())
        second = (n * values[:, None]).T @ n / len(n) / mean
        B = 7.5 * (second - IDENTITY / 3.0)
        if order == 2:
            return DirectionalFit(mean, B, zero4)
        products = _products(n)
        fourth = _as_tensor((products * values[:, None]).T @ products / len(n) / mean)
        B4 = 315.0 / 8.0 * traceless(fourth)
    return DirectionalFit(mean, B, B4)


def second_order(full: DirectionalFit) -> DirectionalFit:
    """Return the same fit without its fourth-order term."""
    return dataclasses.replace(full, fourth=np.zeros((3, 3, 3, 3)))


def normal_density(n: np.ndarray, order: int = 2) -> DirectionalFit:
    """Fit the density of contact normals E_PDF(n), f0 = 1/(4 pi) (Eqs. 9, 10), to unit vectors n (m, 3).

    The result is NaN for m = 0.
    """
    return dataclasses.replace(directional_fit(n, np.ones(len(n)), order), mean=0.25 / np.pi)


def directional_mean(n: np.ndarray, values: np.ndarray, density: DirectionalFit) -> DirectionalFit:
    """Fit the mean of `values` (m,) in the direction n, with the order of `density`, the fit of E_PDF.

    Rows are weighted by 1/(1 + n.A n + ...), so that directions with many contacts do not weigh more (Eqs. 24, 25).
    """
    order = 4 if density.fourth.any() else 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return directional_fit(n, values / density.shape(n), order)


@dataclasses.dataclass(frozen=True, eq=False)
class TangentialFit:
    """A fitted vector function t(n) = G n - (n.G n) n + W n + B4:nnn - (B4::nnnn) n, without a component along n.

    Args:
        second: G, symmetric, (3, 3).
        skew: W, (3, 3).
        fourth: B4, (3, 3, 3, 3), zero for a fit of second order.
    """

    second: np.ndarray
    skew: np.ndarray
    fourth: np.ndarray

    def at(self, n: np.ndarray) -> np.ndarray:
        """Return the values of t at unit vectors n (m, 3), shape (m, 3)."""
        full = n @ self.second + n @ self.skew.T
        if self.fourth.any():
            full = full + np.einsum("jklq,mk,ml,mq->mj", self.fourth, n, n, n, optimize=True)
        return full - np.einsum("mi,mi->m", full, n)[:, None] * n


def tangential_mean(n: np.ndarray, values: np.ndarray, density: DirectionalFit) -> TangentialFit:
    """Fit the mean of tangential vectors `values` (m, 3), n.t = 0, in the direction n (Eqs. 11, 26, 27).

    Rows are weighted by 1/(1 + n.A n + ...), and the fit has the order of `density`, the fit of E_PDF.
    G = 5 sym<n (x) t>, W = 3 skew<n (x) t>^T, B4 = 63/2 times the symmetric, traceless part of <nnn (x) t>. With
    t = -Lambda_t/Lambda, <n (x) t> is F^t.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        weighted = values / density.shape(n)[:, None]
    nt = n.T @ weighted / max(len(n), 1)
    fourth = np.zeros((3, 3, 3, 3))
    if density.fourth.any():
        both = np.stack([0.5 * (n[:, i] * weighted[:, j] + n[:, j] * weighted[:, i]) for i, j in _PAIRS], axis=1)
        nnnt = _as_tensor(_products(n).T @ both / len(n))
        half = nnnt + nnnt.transpose(2, 3, 0, 1)
        fourth = 63.0 / 2.0 * traceless((half + half.transpose(0, 2, 1, 3) + half.transpose(0, 3, 2, 1)) / 6.0)
    return TangentialFit(2.5 * (nt + nt.T), 1.5 * (nt.T - nt), fourth)


def _products(n):
    """Return the products xx, yy, zz, xy, yz, zx of the components of vectors (m, 3), shape (m, 6)."""
    return np.stack([n[:, i] * n[:, j] for i, j in _PAIRS], axis=1)


def _as_tensor(matrix):
    """Return the fourth-order tensor (3, 3, 3, 3) of a matrix (6, 6) of moments of the six products."""
    return matrix[_PLACE[:, :, None, None], _PLACE[None, None, :, :]]


def _as_matrix(tensor):
    """Return the matrix (6, 6) of the quadratic form in the six products that equals tensor::nnnn."""
    matrix = np.array([[tensor[first + second] for second in _PAIRS] for first in _PAIRS])
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # xy represents both xy and yx
    return matrix * twice[:, None] * twice


ECCENTRICITIES = ("contact_eccentricity", "normal_force_eccentricity", "tangential_force_eccentricity")
SYMBOLS = {
    "contact_anisotropy": "A",
    "normal_force_anisotropy": "F",
    "mobilisation": "F^t",
    "contact_eccentricity": "G",
    "normal_force_eccentricity": "M",
    "tangential_force_eccentricity": "X",
}


@dataclasses.dataclass(frozen=True, eq=False)
class Statistics:
    """State variables of C0. Without contacts, Z and Lambda are 0 and the tensors are NaN (undefined).

    Args:
        coordination_number: Z = Nc/Ng, where Nc counts each contact twice, once for each side.
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

    @property
    def contact_eccentricity(self) -> np.ndarray | None:
        """G of labkit.micro.eccentricity, (3, 3); None for spheres."""
        return None

    @property
    def normal_force_eccentricity(self) -> np.ndarray | None:
        """M of labkit.micro.eccentricity, (3, 3), whose first index is that of the contact vector; None for spheres."""
        return None

    @property
    def tangential_force_eccentricity(self) -> np.ndarray | None:
        """X of labkit.micro.eccentricity, (3, 3), whose first index is that of the contact vector; None for spheres."""
        return None

    @property
    def eccentricity(self) -> np.ndarray | None:
        """M - X, the terms of C0 for eccentric contacts, (3, 3); None for spheres."""
        M, X = self.normal_force_eccentricity, self.tangential_force_eccentricity
        return None if M is None or X is None else M - X

    def by_name(self) -> dict[str, Any]:
        """Return the statistics defined for these grains: name in run files -> value."""
        of_shape = {name: getattr(self, name) for name in ECCENTRICITIES}
        return vars(self) | {name: value for name, value in of_shape.items() if value is not None}

    def __str__(self) -> str:
        tensors = {SYMBOLS[name]: value for name, value in self.by_name().items() if name in SYMBOLS}
        rows = [
            "".join(f"{'':4}" + "".join(f"{x:8.4f}" for x in tensor[i]) for tensor in tensors.values())
            for i in range(3)
        ]
        names = "".join(f"{name:>14}{'':14}" for name in tensors).rstrip()
        scalars = f"Z = {self.coordination_number:.4g}, Lambda = {self.mean_normalised_force:.4g}"
        return "\n".join([scalars, names, *rows])


@dataclasses.dataclass(frozen=True, eq=False)
class _OfClumps(Statistics):
    """Statistics of grains that are not spheres; `shape` contains G, M and X, (3, 3, 3)."""

    shape: np.ndarray

    contact_eccentricity = property(lambda self: self.shape[0])
    normal_force_eccentricity = property(lambda self: self.shape[1])
    tangential_force_eccentricity = property(lambda self: self.shape[2])

    def by_name(self) -> dict[str, Any]:
        values = super().by_name()
        del values["shape"]
        return values


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """Directional functions of a set of Vectors: E_PDF, mean Lambda_n, and F^t.

    Args:
        density: Fit of E_PDF(n), whose second-order tensor is A.
        normal_force: Fit of the mean of Lambda_n in the direction n, whose mean is Lambda and whose second-order
            tensor is F.
        mobilisation: F^t of Eq. 27, weighted with `density`, (3, 3).
        eccentricity: M and X of labkit.micro.eccentricity, (2, 3, 3); None for spheres.
    """

    density: DirectionalFit
    normal_force: DirectionalFit
    mobilisation: np.ndarray
    eccentricity: np.ndarray | None = None


def series_of(vectors: Vectors, order: int = 2) -> Series:
    """Return the Series of a non-empty set of Vectors; E_PDF and Lambda_n are of order 2 (Eqs. 10, 24, 25, 27) or 4."""
    n = vectors.normal
    density = normal_density(n, order)
    with np.errstate(divide="ignore", invalid="ignore"):
        shape = density.shape(n)  # 1 + n.A n + ...
        normal_force = directional_fit(n, vectors.normal_component / shape, order)  # Eqs. 24, 25
        mobilisation = -(n.T @ (vectors.tangential / shape[:, None])) / len(n) / normal_force.mean  # Eq. 27
        eccentric = vectors.eccentric
        eccentricity = None if eccentric is None else eccentric.mean(axis=1) / normal_force.mean
    return Series(density, normal_force, mobilisation, eccentricity)


def contact_anisotropy(normal: np.ndarray) -> np.ndarray:
    """Return the contact anisotropy A = 15/2 (<n n> - I/3) (Eq. 10), (3, 3), of unit vectors (n, 3); NaN for n = 0."""
    return normal_density(normal).second


def statistics(snapshot: Snapshot) -> Statistics:
    """Return the state variables of C0 in a snapshot: Z, A, Lambda, F and F^t (Eqs. 10, 24, 25, 27).

    As in the paper, Lambda_n contains the volume of the grain on which the force acts. For grains that are not spheres,
    G, M and X are included (labkit.micro.eccentricity).
    """
    return _statistics(snapshot, None)


def statistics_by_volume(snapshot: Snapshot) -> Statistics:
    """Return the state variables of the equation by volume, whose Lambda_n contains the mean volume of the grains.

    Z, A and G are those of `statistics`; Lambda, F, F^t, M and X differ unless all grains have the same volume. With
    these variables C0 gives the mean stress of Love exactly, for grains of any sizes and shapes (docs/theory.md).
    """
    return _statistics(snapshot, mean_volume(snapshot))


def _statistics(snapshot, volume):
    """Return the Statistics with these grain volumes, (grain,), m3, or with the volume of each grain if None."""
    contacts = contacts_of(snapshot)
    if len(contacts) == 0:
        undefined = np.full((3, 3), np.nan)
        empty = 0.0, undefined, 0.0, undefined, undefined
        return Statistics(*empty) if contacts.vectors is None else _OfClumps(*empty, np.stack([undefined] * 3))
    series = series_of(vectors_of_contacts(snapshot, volume))
    force = series.normal_force
    Z = 2 * len(contacts) / snapshot.number_of_grains
    scalars_and_tensors = Z, series.density.second, force.mean, force.second, series.mobilisation
    if series.eccentricity is None:
        return Statistics(*scalars_and_tensors)
    G = contact_eccentricity(snapshot, series.density.shape(contacts.normal))
    return _OfClumps(*scalars_and_tensors, np.stack([G, *series.eccentricity]))
