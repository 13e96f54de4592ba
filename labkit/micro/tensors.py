"""Symmetric tensors as six numbers in Mandel notation: xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy.

With the factors sqrt2, the sum of squares is the squared norm of the tensor, and A:B is the dot product of the numbers.
"""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError

ROOT2 = float(np.sqrt(2.0))
COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")
_WEIGHT = np.array([1.0, 1.0, 1.0, ROOT2, ROOT2, ROOT2])
_ROW, _COLUMN = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])
_PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def to_six(tensor: np.ndarray) -> np.ndarray:
    """Convert symmetric tensors (..., 3, 3) to (..., 6), reading only the upper triangles (see require_symmetric)."""
    return np.asarray(tensor, dtype=float)[..., _ROW, _COLUMN] * _WEIGHT


def to_tensor(six: np.ndarray) -> np.ndarray:
    """Convert (..., 6) to tensors (..., 3, 3)."""
    return (np.asarray(six, dtype=float) / _WEIGHT)[..., _PLACE]


def symmetric(tensor: np.ndarray) -> np.ndarray:
    """Return the symmetric part of a tensor (..., 3, 3)."""
    tensor = np.asarray(tensor, dtype=float)
    return 0.5 * (tensor + np.swapaxes(tensor, -1, -2))


def require_symmetric(name: str, tensor: np.ndarray, deviatoric: bool = False) -> np.ndarray:
    """Return the tensor as a float array (..., 3, 3); `name` is used in the message.

    Raises InputError unless the tensor is finite, symmetric and, with `deviatoric`, traceless, up to rounding errors.
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
