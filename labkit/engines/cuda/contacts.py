"""Kernels of contact forces and of Love's stress.

`pair` and `spring` are functions of the contact law (labkit.dem.laws.ContactLaw), the same that the fused engine
compiles; labkit.engines.cuda.build replaces them and the functions that read the law's parameters.
"""

from __future__ import annotations

import math
from typing import Any

from numba import cuda

from labkit.dem.laws.base import Contact, ContactLaw
from labkit.dem.laws.vectors import ZERO, dot, length_and_inverse, minus, plus, times
from labkit.engines.cuda.arrays import (
    CELL_WORK,
    DAMPING_LOSS,
    FRICTION_LOSS,
    ROLLING_LOSS,
    Grains,
    Lists,
    States,
)
from labkit.engines.cuda.device import BLOCK, SLICE
from labkit.engines.cuda.motion import damping_of as absent
from labkit.engines.cuda.motion import product, put, vector

pair, spring = ContactLaw.pair, ContactLaw.spring
constants_of = friction_of = rolling_of = dashpots_of = absent

STRESSES = 9  # components of the stress


def forces(states: States, grains: Grains, lists: Lists, moving: float) -> None:
    """Compute forces and torques of running states that need no search. One thread per grain.

    moving: 1, or 0 to leave the history as it is, for a state that was just loaded.
    """
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if states.running[s] == 0 or states.due[s] == 1 or g - states.first[s] >= states.grains[s]:
        return
    dt = moving * states.time_step[s]
    constants, friction = constants_of(states.law, s), friction_of(states.law, s)
    rolling, dashpots = rolling_of(states.law, s), dashpots_of(states.law, s)
    force = torque = ZERO
    cell_work = friction_loss = rolling_loss = dashpot_loss = 0.0
    side = lists.side[s]
    base = lists.region[side, s] + lists.slice_first[side, g // SLICE] + g % SLICE
    for at in range(base, base + SLICE * lists.count[side, g], SLICE):
        b = lists.partner[at]
        is_first = b >= 0
        sign = 1.0 if is_first else -1.0
        one, two = (g, b) if is_first else (~b, g)
        periods = (sign * lists.shift[0, at], sign * lists.shift[1, at], sign * lists.shift[2, at])
        d = minus(plus(vector(grains.position, two), product(states.cell, s, periods)), vector(grains.position, one))
        distance, inverse = length_and_inverse(dot(d, d))
        radius_a, radius_b = grains.radius[one], grains.radius[two]
        overlap = radius_a + radius_b - distance
        t, m = vector(lists.history, at), (lists.history[3, at], lists.history[4, at], lists.history[5, at])
        if overlap < 0.0 and dot(t, t) == 0.0 and dot(m, m) == 0.0:
            continue  # the law gives zeros
        drift = product(states.drift, s, periods)
        v = minus(plus(vector(grains.velocity, two), drift), vector(grains.velocity, one))
        spin_a, spin_b = vector(grains.spin, one), vector(grains.spin, two)
        contact = Contact(
            lists.stiffness[at], radius_a, radius_b, overlap, inverse, d, times(inverse, d), v, spin_a, spin_b
        )
        response = pair(contact, t, m, dt, constants, friction, rolling, dashpots, True)
        put(lists.history, at, response.tangential_force)
        lists.history[3, at], lists.history[4, at], lists.history[5, at] = response.rolling_moment
        force = plus(force, times(sign, response.force))
        if is_first:
            torque = plus(torque, response.torque_a)
            cell_work += dt * dot(response.force, product(states.used, s, d))
            friction_loss += response.friction_loss
            rolling_loss += response.rolling_loss
            dashpot_loss += response.dashpot_loss
        else:
            torque = plus(torque, response.torque_b)
    put(grains.force, g, force)
    put(grains.torque, g, torque)
    grains.energies[CELL_WORK, g] += cell_work
    grains.energies[FRICTION_LOSS, g] += friction_loss
    grains.energies[ROLLING_LOSS, g] += rolling_loss
    grains.energies[DAMPING_LOSS, g] += dashpot_loss


def elastic_force(states: States, grains: Grains, lists: Lists, s: int, g: int, at: int) -> tuple[Any, Any]:
    """Branch, m, and force of the springs on the first grain g, N, of the contact `at`."""
    b = lists.partner[at]
    periods = (1.0 * lists.shift[0, at], 1.0 * lists.shift[1, at], 1.0 * lists.shift[2, at])
    d = minus(plus(vector(grains.position, b), product(states.cell, s, periods)), vector(grains.position, g))
    distance = math.sqrt(dot(d, d))
    overlap = grains.radius[g] + grains.radius[b] - distance
    share = -spring(lists.stiffness[at], overlap) / distance if overlap >= 0.0 else 0.0
    return d, plus(times(share, d), vector(lists.history, at))


def block_sum(values: Any, t: int) -> float:
    """Sum of values (BLOCK,), shared by the threads t of a block, in a fixed order."""
    cuda.syncthreads()
    half = BLOCK // 2
    while half > 0:
        if t < half:
            values[t] += values[t + half]
        cuda.syncthreads()
        half //= 2
    return values[0]


def stress_of_blocks(states: States, grains: Grains, lists: Lists, sums: Any) -> None:
    """Sum branch (x) force over the contacts of the grains of each block, into sums (STRESSES, block), N m.

    The dashpot forces are excluded, as in records. One thread per grain.
    """
    g, t, s = cuda.grid(1), cuda.threadIdx.x, grains.state[cuda.blockIdx.x]
    values = cuda.shared.array(BLOCK, "float64")
    side = lists.side[s]
    base = lists.region[side, s] + lists.slice_first[side, g // SLICE] + g % SLICE
    count = lists.count[side, g] if g - states.first[s] < states.grains[s] else 0
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for at in range(base, base + SLICE * count, SLICE):
        if lists.partner[at] >= 0:
            d, f = elastic_force(states, grains, lists, s, g, at)
            xx, xy, xz = xx + d[0] * f[0], xy + d[0] * f[1], xz + d[0] * f[2]
            yx, yy, yz = yx + d[1] * f[0], yy + d[1] * f[1], yz + d[1] * f[2]
            zx, zy, zz = zx + d[2] * f[0], zy + d[2] * f[1], zz + d[2] * f[2]
    own = (xx, xy, xz, yx, yy, yz, zx, zy, zz)
    for k in range(STRESSES):
        cuda.syncthreads()
        values[t] = own[k]
        total = block_sum(values, t)
        if t == 0:
            sums[k, cuda.blockIdx.x] = total


def stress_of_states(states: States, sums: Any, totals: Any) -> None:
    """Sum sums (STRESSES, block) over the blocks of each state into totals (n, STRESSES). One block per number."""
    s, k, t = cuda.blockIdx.x, cuda.blockIdx.y, cuda.threadIdx.x
    values = cuda.shared.array(BLOCK, "float64")
    first, last = states.first[s] // BLOCK, (states.first[s] + states.grains[s] + BLOCK - 1) // BLOCK
    own = 0.0
    for block in range(first + t, last, BLOCK):
        own += sums[k, block]
    values[t] = own
    total = block_sum(values, t)
    if t == 0:
        totals[s, k] = total
