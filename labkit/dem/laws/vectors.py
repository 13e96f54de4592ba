"""Three-component vectors as tuples of numbers, for the formulas of a contact.

Plain Python: the `fused` engine compiles these functions, and they can also be called directly when reading or testing
a contact law. The compiler keeps the tuples in registers, so that they need no memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


def plus(a: Vector, b: Vector) -> Vector:
    """Sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(s: float, a: Vector) -> Vector:
    """Product s a."""
    return s * a[0], s * a[1], s * a[2]


def dot(a: Vector, b: Vector) -> float:
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def inverse_root(x: float) -> float:
    """1/sqrt(x) for x > 0, accurate to rounding; finite at 0.

    Newton's iteration from an initial guess obtained by halving the exponent. With vector instructions it takes a third
    of the time of a square root and a division.
    """
    y = np.int64(0x5FE6EB50C7B537A9 - (np.float64(x).view(np.int64) >> 1)).view(np.float64)
    half = 0.5 * x
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    return y + y * (0.5 - half * y * y)


def inverse_root_single(x: float) -> float:
    """The same for a number in single precision, by which the kernel replaces `inverse_root` in mixed precision."""
    y: Any = np.int32(np.int32(0x5F375A86) - (np.float32(x).view(np.int32) >> np.int32(1))).view(np.float32)
    half = 0.5 * x
    y = y * (1.5 - half * y * y)
    y = y * (1.5 - half * y * y)
    return y + y * (0.5 - half * y * y)


def length_and_inverse(squared: float) -> tuple[float, float]:
    """sqrt(x) and 1/sqrt(x); the root matches that of the processor except possibly in the last bit."""
    inverse = inverse_root(squared)
    length = squared * inverse
    return length + 0.5 * inverse * (squared - length * length), inverse


def cap(squared: float, limit: float) -> float:
    """Factor that limits the length of a vector to `limit` >= 0, given its squared length."""
    return limit * inverse_root(squared) if squared > limit * limit else 1.0


def along_branch(d: Vector, v: Vector, dt: float, inverse: float) -> Vector:
    """Unit vector along the branch as it was a time dt earlier, by one Newton step.

    d: current branch; v: its rate of change; `inverse`: 1/|d|.
    """
    o = minus(d, times_right(v, dt))
    before = inverse * (1.5 - 0.5 * dot(o, o) * inverse * inverse)
    return times_right(o, before)


def times_right(a: Vector, s: float) -> Vector:
    """Product a s."""
    return a[0] * s, a[1] * s, a[2] * s
