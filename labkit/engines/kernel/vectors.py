"""Three-vectors as scalars: what the compiler turns into lanes."""

from __future__ import annotations

import math

from labkit.engines.kernel.layout import compiled


@compiled
def cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@compiled
def dot(ax, ay, az, bx, by, bz):
    return ax * bx + ay * by + az * bz


@compiled
def cap(squared, limit):
    """What a vector of that squared length must be multiplied with to be no longer than `limit` >= 0."""
    return limit / math.sqrt(squared) if squared > limit * limit else 1.0
