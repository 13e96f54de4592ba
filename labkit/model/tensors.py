"""Symmetric tensors in compiled code: six numbers (xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy), Mandel notation.

With the sqrt2 factors the sum of squares is the squared Euclidean norm of the tensor, and A:B is a dot product. In
compiled code a tensor is a Six, which needs no memory allocation; elsewhere it is a (..., 3, 3) array.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from labkit.micro.tensors import ROOT2


class _Numbers(NamedTuple):
    xx: float
    yy: float
    zz: float
    yz: float
    xz: float
    xy: float


class Six(_Numbers):
    """A symmetric tensor, with the operations S + T, S - T and s * T."""

    __slots__ = ()
    __array_ufunc__ = None  # so that a numpy number times a tensor calls Six.__rmul__

    def __add__(self, other: Any) -> Six:
        return add(self, other)

    def __sub__(self, other: Six) -> Six:
        return subtract(self, other)

    def __rmul__(self, factor: Any) -> Six:
        return multiply(factor, self)


IDENTITY = Six(1.0, 1.0, 1.0, 0.0, 0.0, 0.0)


def six_at(array: np.ndarray, start: int) -> Six:
    """Read the tensor in array[start] to array[start + 5]."""
    return Six(array[start], array[start + 1], array[start + 2], array[start + 3], array[start + 4], array[start + 5])


def put_six(array: np.ndarray, start: int, T: Six) -> None:
    """Write T to array[start] to array[start + 5]."""
    array[start], array[start + 1], array[start + 2] = T[0], T[1], T[2]
    array[start + 3], array[start + 4], array[start + 5] = T[3], T[4], T[5]


def put(array: np.ndarray, values: np.ndarray) -> None:
    """Write the numbers of `values` (n,) to the first n of `array`.

    Numba takes more than two seconds to compile array[:n] = values, which also compares the shapes.
    """
    for i in range(values.size):
        array[i] = values[i]


def multiply(s: float, T: Six) -> Six:
    """s T."""
    return Six(s * T[0], s * T[1], s * T[2], s * T[3], s * T[4], s * T[5])


def add(S: Six, T: Six) -> Six:
    """S + T."""
    return Six(S[0] + T[0], S[1] + T[1], S[2] + T[2], S[3] + T[3], S[4] + T[4], S[5] + T[5])


def subtract(S: Six, T: Six) -> Six:
    """S - T."""
    return Six(S[0] - T[0], S[1] - T[1], S[2] - T[2], S[3] - T[3], S[4] - T[4], S[5] - T[5])


def contract(S: Six, T: Six) -> float:
    """S:T."""
    return S[0] * T[0] + S[1] * T[1] + S[2] * T[2] + S[3] * T[3] + S[4] * T[4] + S[5] * T[5]


def norm(T: Six) -> float:
    """|T|, the Euclidean norm."""
    return np.sqrt(contract(T, T))


def trace(T: Six) -> float:
    """tr(T)."""
    return T[0] + T[1] + T[2]


def deviatoric_part(T: Six) -> Six:
    """T - tr(T)/3 I."""
    mean = (T[0] + T[1] + T[2]) / 3.0
    return Six(T[0] - mean, T[1] - mean, T[2] - mean, T[3], T[4], T[5])


def six_product(S: Six, T: Six) -> Six:
    """(ST + TS)/2."""
    return Six(
        S[0] * T[0] + 0.5 * (S[5] * T[5] + S[4] * T[4]),
        S[1] * T[1] + 0.5 * (S[5] * T[5] + S[3] * T[3]),
        S[2] * T[2] + 0.5 * (S[4] * T[4] + S[3] * T[3]),
        (S[5] * T[4] + T[5] * S[4]) / (2 * ROOT2) + 0.5 * (S[1] * T[3] + T[1] * S[3] + S[3] * T[2] + T[3] * S[2]),
        (S[5] * T[3] + T[5] * S[3]) / (2 * ROOT2) + 0.5 * (S[0] * T[4] + T[0] * S[4] + S[4] * T[2] + T[4] * S[2]),
        (S[4] * T[3] + T[4] * S[3]) / (2 * ROOT2) + 0.5 * (S[0] * T[5] + T[0] * S[5] + S[5] * T[1] + T[5] * S[1]),
    )


def elastic_stress(G: float, K: float, strain: Six) -> Six:
    """2 G dev(strain) + K tr(strain) I, Pa."""
    return 2.0 * G * deviatoric_part(strain) + K * trace(strain) * IDENTITY
