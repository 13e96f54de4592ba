"""Directional functions of contacts: fits of order 0, 2 and 4 on the sphere (Eqs. 9, 23 and beyond), and bins.

An even function of the direction n is written f(n) = f0 [1 + n.B n + B4::nnnn] with B deviatoric and B4 symmetric
and traceless (Kanatani's tensors of the third kind). For the density of contact normals f0 = 1/(4 pi), B = A.
"""

from __future__ import annotations

import dataclasses

import numpy as np

IDENTITY = np.eye(3)
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
_PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])  # index of the pair ij in a row of six products


def _symmetric_with_identity(B):
    """Fully symmetric part of I (x) B for symmetric B (3, 3), over all 24 orders of the indices; shape (3, 3, 3, 3)."""
    both = np.einsum("ij,kl->ijkl", IDENTITY, B) + np.einsum("ij,kl->ijkl", B, IDENTITY)
    return (both + both.transpose(0, 2, 1, 3) + both.transpose(0, 3, 2, 1)) / 6.0


_IDENTITY4 = _symmetric_with_identity(IDENTITY)


def traceless(S: np.ndarray) -> np.ndarray:
    """Traceless part of a fully symmetric S (3, 3, 3, 3): S - 6/7 sym(I S_iikl) + 3/35 S_iikk sym(I I)."""
    second = np.einsum("iikl->kl", S)
    return S - 6.0 / 7.0 * _symmetric_with_identity(second) + 3.0 / 35.0 * np.trace(second) * _IDENTITY4


@dataclasses.dataclass(frozen=True)
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
        """Values f0 [1 + n.B n + B4::nnnn] at unit vectors n (m, 3), shape (m,)."""
        return self.mean * self.shape(n)

    def shape(self, n: np.ndarray) -> np.ndarray:
        """Values 1 + n.B n + B4::nnnn at unit vectors n (m, 3), shape (m,)."""
        value = 1.0 + np.einsum("mi,mi->m", n @ self.second, n)
        if self.fourth.any():
            products = _products(n)
            half = np.einsum("ma,ab->mb", products, _as_matrix(self.fourth))  # without BLAS and its threads
            value = value + np.einsum("ma,ma->m", half, products)
        return value


def directional_fit(n: np.ndarray, values: np.ndarray, order: int = 2) -> DirectionalFit:
    """Fit a directional function that has the same moments, up to `order`, as the values v in the directions n.

    f0 = <v>, B = 15/2 (<v nn>/f0 - I/3), B4 = 315/8 times the traceless part of <v nnnn>/f0

    <> is the mean over the m rows of `n` (m, 3), unit vectors, and `values` (m,). With v = 1 the result is the density
    of contact normals divided by 1/(4 pi) (Eqs. 9, 10); with v = Lambda_n/(1 + n.A n) it is the mean of Lambda_n in the
    direction n (Eqs. 23-25). All NaN for m = 0 or f0 = 0. Raises ValueError for an order other than 2 or 4.
    """
    if order not in (2, 4):
        raise ValueError(f"order {order} is not valid: use 2 or 4")
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

    Rows are weighted by 1/(1 + n.A n + ...), so that directions with many contacts do not count more (Eqs. 24, 25).
    """
    order = 4 if density.fourth.any() else 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return directional_fit(n, values / density.shape(n), order)


@dataclasses.dataclass(frozen=True)
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
        """Values of t at unit vectors n (m, 3), shape (m, 3)."""
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
    """Products xx, yy, zz, xy, yz, zx of the components of vectors (m, 3), shape (m, 6)."""
    return np.stack([n[:, i] * n[:, j] for i, j in _PAIRS], axis=1)


def _as_tensor(matrix):
    """Fourth-order tensor (3, 3, 3, 3) from a matrix (6, 6) of moments of the six products."""
    return matrix[_PLACE[:, :, None, None], _PLACE[None, None, :, :]]


def _as_matrix(tensor):
    """Matrix (6, 6) of the quadratic form in the six products that equals tensor::nnnn."""
    matrix = np.array([[tensor[first + second] for second in _PAIRS] for first in _PAIRS])
    twice = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # xy represents both xy and yx
    return matrix * twice[:, None] * twice


def polar_bins(n: np.ndarray, bins: int, axis: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Divide directions n (m, 3) into bins of equal solid angle about an axis.

    n and -n are treated as the same direction: the angle from the axis runs from 0 to 90 degrees. Returns the cosines
    of the edges (bins + 1,) and the bin of each row (m,).
    """
    edges = np.linspace(0.0, 1.0, bins + 1)
    return edges, np.clip((np.abs(n[:, axis]) * bins).astype(int), 0, bins - 1)


def bin_means(values: np.ndarray, bin_of: np.ndarray, bins: int) -> np.ndarray:
    """Mean of `values` (m,) in each bin `bin_of` (m,), shape (bins,); NaN for empty bins."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.bincount(bin_of, values, bins) / np.bincount(bin_of, minlength=bins)


def hemisphere_bins(n: np.ndarray, bands: int, sectors: int) -> np.ndarray:
    """Divide the hemisphere z > 0 into bins of equal solid angle: bin of each row (m,), band * sectors + sector.

    `n` (m, 3) is reflected into the hemisphere; bands have equal height in z, sectors equal azimuth.
    """
    up = np.where(n[:, 2:] < 0.0, -n, n)
    band = np.clip((up[:, 2] * bands).astype(int), 0, bands - 1)
    azimuth = np.mod(np.arctan2(up[:, 1], up[:, 0]), 2.0 * np.pi)
    return band * sectors + np.clip((azimuth / (2.0 * np.pi) * sectors).astype(int), 0, sectors - 1)
