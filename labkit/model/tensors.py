"""Symmetric tensors in compiled code: six numbers (xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy), Mandel's order.

With the sqrt2 factors the sum of squares is the squared Euclidean norm of the tensor, and A:B is a dot product. In
compiled code a tensor is a tuple, which needs no memory allocation; elsewhere it is a (..., 3, 3) array.
"""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError
from labkit.model.compiled import compiled

Six = tuple[float, float, float, float, float, float]

ROOT2 = float(np.sqrt(2.0))
IDENTITY: Six = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
ZERO: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_WEIGHT = np.array([1.0, 1.0, 1.0, ROOT2, ROOT2, ROOT2])
_ROW, _COLUMN = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])
_PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def to_six(tensor: np.ndarray) -> np.ndarray:
    """Symmetric tensors (..., 3, 3) -> (..., 6). The lower triangle is ignored: see require_symmetric."""
    return np.asarray(tensor, dtype=float)[..., _ROW, _COLUMN] * _WEIGHT


def to_tensor(six: np.ndarray) -> np.ndarray:
    """Six components (..., 6) -> tensors (..., 3, 3)."""
    return (np.asarray(six, dtype=float) / _WEIGHT)[..., _PLACE]


def require_symmetric(name: str, tensor: np.ndarray, deviatoric: bool = False) -> np.ndarray:
    """The tensor as a float array (..., 3, 3); `name` is its label in messages.

    Raises InputError unless it is finite, symmetric and, with `deviatoric`, traceless, within rounding.
    """
    tensor = np.asarray(tensor, dtype=float)
    if tensor.shape[-2:] != (3, 3):
        raise InputError(f"{name} has the shape {tensor.shape}: give 3 x 3 tensors")
    if not np.isfinite(tensor).all():
        raise InputError(f"{name} has a component that is not finite: give finite components")
    size = 1e-9 * np.linalg.norm(tensor, axis=(-2, -1)).max(initial=0.0) + 1e-300
    if np.abs(tensor - np.swapaxes(tensor, -1, -2)).max(initial=0.0) > size:
        raise InputError(f"{name} is not symmetric: give its symmetric part, (T + T^T)/2")
    if deviatoric and np.abs(np.trace(tensor, axis1=-2, axis2=-1)).max(initial=0.0) > size:
        raise InputError(f"{name} is not deviatoric: give it without its trace, T - tr(T)/3 I")
    return tensor


@compiled
def load(array: np.ndarray, start: int) -> Six:
    """Read the tensor in array[start] to array[start + 5]."""
    return (array[start], array[start + 1], array[start + 2], array[start + 3], array[start + 4], array[start + 5])


@compiled
def store(array: np.ndarray, start: int, T: Six) -> None:
    """Write T to array[start] to array[start + 5]."""
    array[start], array[start + 1], array[start + 2] = T[0], T[1], T[2]
    array[start + 3], array[start + 4], array[start + 5] = T[3], T[4], T[5]


@compiled
def times(s: float, T: Six) -> Six:
    """s T."""
    return (s * T[0], s * T[1], s * T[2], s * T[3], s * T[4], s * T[5])


@compiled
def plus(S: Six, T: Six) -> Six:
    """S + T."""
    return (S[0] + T[0], S[1] + T[1], S[2] + T[2], S[3] + T[3], S[4] + T[4], S[5] + T[5])


@compiled
def minus(S: Six, T: Six) -> Six:
    """S - T."""
    return (S[0] - T[0], S[1] - T[1], S[2] - T[2], S[3] - T[3], S[4] - T[4], S[5] - T[5])


@compiled
def dot(S: Six, T: Six) -> float:
    """S:T."""
    return S[0] * T[0] + S[1] * T[1] + S[2] * T[2] + S[3] * T[3] + S[4] * T[4] + S[5] * T[5]


@compiled
def norm(T: Six) -> float:
    """|T|, the Euclidean norm."""
    return np.sqrt(dot(T, T))


@compiled
def trace(T: Six) -> float:
    """tr(T)."""
    return T[0] + T[1] + T[2]


@compiled
def deviator(T: Six) -> Six:
    """T - tr(T)/3 I."""
    mean = (T[0] + T[1] + T[2]) / 3.0
    return (T[0] - mean, T[1] - mean, T[2] - mean, T[3], T[4], T[5])


@compiled
def symmetric_product(S: Six, T: Six) -> Six:
    """(ST + TS)/2."""
    return (
        S[0] * T[0] + 0.5 * (S[5] * T[5] + S[4] * T[4]),
        S[1] * T[1] + 0.5 * (S[5] * T[5] + S[3] * T[3]),
        S[2] * T[2] + 0.5 * (S[4] * T[4] + S[3] * T[3]),
        (S[5] * T[4] + T[5] * S[4]) / (2 * ROOT2) + 0.5 * (S[1] * T[3] + T[1] * S[3] + S[3] * T[2] + T[3] * S[2]),
        (S[5] * T[3] + T[5] * S[3]) / (2 * ROOT2) + 0.5 * (S[0] * T[4] + T[0] * S[4] + S[4] * T[2] + T[4] * S[2]),
        (S[4] * T[3] + T[4] * S[3]) / (2 * ROOT2) + 0.5 * (S[0] * T[5] + T[0] * S[5] + S[5] * T[1] + T[5] * S[1]),
    )
