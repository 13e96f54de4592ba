"""Three-component vectors with operators, for the formulas of a contact.

The functions are plain Python, which the engines also compile (labkit.engines.kernel.translate). The compiler keeps
the components in registers, so a vector needs no memory.
"""

from __future__ import annotations

import operator
from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike


class _Components(NamedTuple):
    x: float
    y: float
    z: float


class Vector(_Components):
    """A vector (x, y, z) with the algebraic operators a + b, a - b, s * a and -a."""

    __slots__ = ()
    __array_ufunc__ = None  # lets Vector compute the product of a NumPy number and a Vector

    def __add__(self, other: tuple[Any, ...]) -> Vector:
        return vector_sum(self, Vector(*other))

    def __sub__(self, other: tuple[Any, ...]) -> Vector:
        return difference(self, Vector(*other))

    def __rmul__(self, factor: SupportsIndex | float) -> Vector:
        return product(factor, self)

    def __mul__(self, factor: SupportsIndex | float) -> Vector:
        return product(factor, self)

    def __neg__(self) -> Vector:
        return opposite(self)


def vector_sum(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return Vector(a.x + b.x, a.y + b.y, a.z + b.z)


def difference(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return Vector(a.x - b.x, a.y - b.y, a.z - b.z)


def product(a: Any, b: Vector) -> Vector:
    """Return the product of a number and a vector."""
    return Vector(a * b.x, a * b.y, a * b.z)


def opposite(a: Vector) -> Vector:
    """Return -a."""
    return Vector(-a.x, -a.y, -a.z)


SUMS = (
    (operator.add, vector_sum),
    (operator.iadd, vector_sum),
    (operator.sub, difference),
    (operator.isub, difference),
)
ZERO = Vector(0.0, 0.0, 0.0)


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product a . b."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a x b."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def transform(matrix: np.ndarray, a: Vector) -> Vector:
    """Return the product of a matrix (3, 3) and a vector."""
    return Vector(
        matrix[0, 0] * a.x + matrix[0, 1] * a.y + matrix[0, 2] * a.z,
        matrix[1, 0] * a.x + matrix[1, 1] * a.y + matrix[1, 2] * a.z,
        matrix[2, 0] * a.x + matrix[2, 1] * a.y + matrix[2, 2] * a.z,
    )


def across(a: Vector, n: Vector) -> Vector:
    """Return the part of a that is perpendicular to the unit vector n."""
    return a - dot(a, n) * n


def inverse_root(x: float) -> float:
    """Return 1/sqrt(x) for x > 0, accurate to rounding; finite at 0.

    Newton's iteration starts from a guess obtained by halving the exponent. With vector instructions it takes a third
    of the time of a square root and a division.
    """
    y = np.int64(0x5FE6EB50C7B537A9 - (np.float64(x).view(np.int64) >> 1)).view(np.float64)
    half = 0.5 * x
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    return y + y * (0.5 - half * y * y)


def inverse_root_single(x: float) -> float:
    """Return 1/sqrt(x) in single precision; replaces `inverse_root` in kernels of mixed precision."""
    y: Any = np.int32(np.int32(0x5F375A86) - (np.float32(x).view(np.int32) >> np.int32(1))).view(np.float32)
    half = 0.5 * x
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    return y + y * (0.5 - half * y * y)


def choose(condition: ArrayLike, one: ArrayLike, other: ArrayLike) -> Any:
    """Return `one` where a condition holds and `other` elsewhere, for numbers and arrays."""
    return np.where(condition, one, other)


def choose_number(condition: bool, one: float, other: float) -> float:
    """Return `one` if a condition holds, else `other`; this function replaces `choose` in kernels."""
    return one if condition else other


def length_and_inverse(squared: float) -> tuple[float, float]:
    """Return sqrt(x) and 1/sqrt(x) of `squared`; the root may differ from the processor's in the last bit."""
    inverse = inverse_root(squared)
    length = squared * inverse
    return length + 0.5 * inverse * (squared - length * length), inverse


def cap(squared: float, limit: float) -> float:
    """Return the factor that limits the length of a vector to `limit` >= 0, given its squared length."""
    return limit * inverse_root(squared) if squared > limit * limit else 1.0
