"""Kernels of contact forces and of Love's stress.

`pair` and `spring` are functions of the contact law (labkit.grains.laws.ContactLaw), the same that the fused engine
compiles; labkit.engines.cuda.build replaces them and the functions that read the law's parameters.
"""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.cuda.arrays import (
    CELL_WORK,
    DAMPING_LOSS,
    FRICTION_LOSS,
    ROLLING_LOSS,
    DeviceArray,
    DeviceGrains,
    Lists,
    States,
)
from labkit.engines.cuda.device import BLOCK, SLICE, cuda
from labkit.engines.cuda.motion import damping_of as absent
from labkit.engines.cuda.motion import set_vector, vector
from labkit.engines.cuda.servo import Plans, asks
from labkit.engines.kernel.compiling import Untyped
from labkit.grains.laws.contact import Contact
from labkit.grains.laws.vectors import ZERO, Vector, dot, length_and_inverse, transform

pair: Untyped = None
spring: Untyped = None
shear_of = friction_of = rolling_of = twisting_of = dashpots_of = whole_of = absent
SINGLE: Untyped = np.float32
KIND: Untyped = np.float64  # type of the numbers of a contact; in mixed precision np.float32

STRESSES = 9  # components of the stress


def as_contact(v: Vector) -> Vector:
    """Round a vector to the precision of contacts, here double."""
    return v


def as_single(v: Vector) -> Vector:
    """Round a vector to single precision."""
    return Vector(SINGLE(v.x), SINGLE(v.y), SINGLE(v.z))


def double(v: Vector) -> Vector:
    """Convert a vector to double precision, in which all sums are taken."""
    return Vector(np.float64(v.x), np.float64(v.y), np.float64(v.z))


def overlap_of(radii: float, squared: float, distance: float) -> float:
    """Overlap of a contact, m.

    Args:
        radii: Sum of the radii, m.
        squared: Square of the branch length, m2.
        distance: Branch length, m.
    """
    return radii - distance


def precise_overlap(radii: float, squared: float, distance: float) -> Untyped:
    """The same as (R^2 - d^2)/(R + |d|), with the numerator in double precision: accurate to single precision."""
    return np.float32(radii * radii - squared) / (np.float32(radii) + distance)


def forces(states: States, grains: DeviceGrains, lists: Lists, moving: float) -> None:
    """Compute forces and torques of running states that need no search. One thread per grain.

    `moving` is 1, or 0 to leave the history as it is, for a state that was just loaded.
    """
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if states.running[s] == 0 or states.due[s] == 1 or g - states.first[s] >= states.grains[s]:
        return
    dt = moving * states.time_step[s]
    shear, friction, rolling = shear_of(states.law, s), friction_of(states.law, s), rolling_of(states.law, s)
    twisting, dashpots, whole = twisting_of(states.law, s), dashpots_of(states.law, s), whole_of(states.law, s)
    force = torque = ZERO
    cell_work = friction_loss = rolling_loss = dashpot_loss = 0.0
    side = lists.side[s]
    base = lists.region[side, s] + lists.slice_first[side, g // SLICE] + g % SLICE
    for at in range(base, base + SLICE * lists.count[side, g], SLICE):
        b = lists.partner[at]
        is_first = b >= 0
        sign = 1.0 if is_first else -1.0
        one, two = (g, b) if is_first else (~b, g)
        periods = Vector(sign * lists.shift[0, at], sign * lists.shift[1, at], sign * lists.shift[2, at])
        d = vector(grains.position, two) + transform(states.cell[s], periods) - vector(grains.position, one)
        near = as_contact(d)
        distance, inverse = length_and_inverse(dot(near, near))
        overlap = overlap_of(grains.radius[one] + grains.radius[two], dot(d, d), distance)
        t = vector(lists.history, at)
        m = Vector(lists.history[3, at], lists.history[4, at], lists.history[5, at])
        if overlap < 0.0 and dot(t, t) == 0.0 and dot(m, m) == 0.0:
            continue  # the law gives zeros
        drift = transform(states.drift[s], periods)
        contact = Contact(
            lists.stiffness[at],
            KIND(grains.radius[one]),
            KIND(grains.radius[two]),
            overlap,
            inverse,
            near,
            inverse * near,
            as_contact(vector(grains.velocity, two) + drift - vector(grains.velocity, one)),
            as_contact(vector(grains.spin, one)),
            as_contact(vector(grains.spin, two)),
        )
        response = pair(
            contact, t, m, KIND(dt), True, shear, friction, rolling, twisting, dashpots, whole, None, None, 0.0, None
        )
        push = double(response.force)
        set_vector(lists.history, at, response.tangential_force)
        lists.history[3, at], lists.history[4, at], lists.history[5, at] = response.rolling_moment
        force += sign * push
        torque += double(response.torque_a if is_first else response.torque_b)
        counted = 1.0 if is_first else 0.0  # energies belong to the first grain
        cell_work += counted * dt * dot(push, transform(states.used[s], d))
        friction_loss += counted * response.friction_loss
        rolling_loss += counted * response.rolling_loss
        dashpot_loss += counted * response.dashpot_loss
    set_vector(grains.force, g, force)
    set_vector(grains.torque, g, torque)
    grains.energies[CELL_WORK, g] += cell_work
    grains.energies[FRICTION_LOSS, g] += friction_loss
    grains.energies[ROLLING_LOSS, g] += rolling_loss
    grains.energies[DAMPING_LOSS, g] += dashpot_loss


def branch(states: States, grains: DeviceGrains, lists: Lists, s: int, g: int, at: int) -> Vector:
    """Branch from grain g, the first of contact `at`, m."""
    b = lists.partner[at]
    periods = Vector(1.0 * lists.shift[0, at], 1.0 * lists.shift[1, at], 1.0 * lists.shift[2, at])
    return vector(grains.position, b) + transform(states.cell[s], periods) - vector(grains.position, g)


def sum_of_block(rows: DeviceArray, t: int) -> float:
    """Sum of column t, if t < STRESSES, of the rows (BLOCK, STRESSES) that the threads of a block share."""
    cuda.syncthreads()
    total = 0.0
    if t < STRESSES:
        for k in range(BLOCK):
            total += rows[k, t]
    return total


def stress_of_blocks(
    states: States, grains: DeviceGrains, lists: Lists, plans: Plans, sums: DeviceArray, every: int
) -> None:
    """Sum branch (x) force over the contacts of the grains of each block, into sums (block, STRESSES), N m.

    The dashpot forces are excluded, as in records. `every` is 1 for all states, 0 for those whose servo needs the
    stress. One thread per grain.
    """
    g, t, s = cuda.grid(1), cuda.threadIdx.x, grains.state[cuda.blockIdx.x]
    rows = cuda.shared.array((BLOCK, STRESSES), np.float64)
    if every == 0 and not asks(states, plans, s):
        return
    for k in range(STRESSES):
        rows[t, k] = 0.0
    side = lists.side[s]
    base = lists.region[side, s] + lists.slice_first[side, g // SLICE] + g % SLICE
    count = lists.count[side, g] if g - states.first[s] < states.grains[s] else 0
    for at in range(base, base + SLICE * count, SLICE):
        if lists.partner[at] >= 0:
            d = branch(states, grains, lists, s, g, at)
            distance = math.sqrt(dot(d, d))
            overlap = grains.radius[g] + grains.radius[lists.partner[at]] - distance
            share = -spring(np.float64(lists.stiffness[at]), overlap) / distance if overlap >= 0.0 else 0.0
            f = share * d + double(vector(lists.history, at))
            for k in range(3):
                for j in range(3):
                    rows[t, 3 * k + j] += d[k] * f[j]
    total = sum_of_block(rows, t)
    if t < STRESSES:
        sums[cuda.blockIdx.x, t] = total


def stress_of_states(states: States, plans: Plans, sums: DeviceArray, totals: DeviceArray, every: int) -> None:
    """Sum sums (block, STRESSES) over the blocks of each state into totals (n, STRESSES). One block per state."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    rows = cuda.shared.array((BLOCK, STRESSES), np.float64)
    if every == 0 and not asks(states, plans, s):
        return
    first, last = states.first[s] // BLOCK, (states.first[s] + states.grains[s] + BLOCK - 1) // BLOCK
    for k in range(STRESSES):
        rows[t, k] = 0.0
        for block in range(first + t, last, BLOCK):
            rows[t, k] += sums[block, k]
    total = sum_of_block(rows, t)
    if t < STRESSES:
        totals[s, t] = total
