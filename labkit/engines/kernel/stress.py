"""Love's stress of the contacts as they lie in the kernel: springs alone, as in the records."""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.kernel.layout import HISTORY, KN, RADIUS_A, RADIUS_B, WIDTH, D, compiled
from labkit.engines.kernel.steps import read_sites, whole_lanes


@compiled
def block_stress(block, work, n, friction, sums):
    """Adds branch (x) force on the first grain of n contacts to `sums` (9 WIDTH,)."""
    for i in range(n):
        dx, dy, dz = work[D + i], work[D + WIDTH + i], work[D + 2 * WIDTH + i]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        overlap = block[RADIUS_A + i] + block[RADIUS_B + i] - distance
        share = -block[KN + i] * overlap / distance if overlap >= 0.0 else 0.0
        fx, fy, fz = share * dx, share * dy, share * dz
        if friction is not None:
            fx += block[HISTORY + i]
            fy += block[HISTORY + WIDTH + i]
            fz += block[HISTORY + 2 * WIDTH + i]
        sums[i] += dx * fx
        sums[WIDTH + i] += dx * fy
        sums[2 * WIDTH + i] += dx * fz
        sums[3 * WIDTH + i] += dy * fx
        sums[4 * WIDTH + i] += dy * fy
        sums[5 * WIDTH + i] += dy * fz
        sums[6 * WIDTH + i] += dz * fx
        sums[7 * WIDTH + i] += dz * fy
        sums[8 * WIDTH + i] += dz * fz


@compiled
def branch_force(sites, pairs, blocks, work, contact_first, contact_last, friction):
    """Sum over contacts of branch (x) force on the first grain, (3, 3), N m."""
    sums = np.zeros(9 * WIDTH)
    for d in range(len(contact_first)):
        for start in range(contact_first[d], contact_last[d], WIDTH):
            n = min(WIDTH, contact_last[d] - start)
            end = start + whole_lanes(n)
            read_sites(sites, pairs[0, start:end], pairs[1, start:end], work, None)
            block_stress(blocks[start // WIDTH], work, n, friction, sums)
    return sums.reshape((9, WIDTH)).sum(axis=1).reshape((3, 3))
