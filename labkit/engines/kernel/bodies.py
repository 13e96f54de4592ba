"""Rigid clumps: sums forces and moments on their spheres, moves the bodies, and places the spheres.

The kernel treats the spheres of a clump as ordinary grains, but `sum_forces` clears the forces on them before move_rows
moves the grains, and `place_members` then overwrites their position, velocity and spin. L and L- are defined in
labkit.engines.kernel.motion. With the angular momentum l, the moment T and the rotation R(q) from the principal axes,
in which I is diagonal, a step is

    l+ = l + dt T + I spin(L - L-)      q' = q + dt/4 q' w(q')      q+ = 2 q' - q      w(q) = I^-1 R(q)^T l+

q' is the orientation at half the step: the rotation is the implicit midpoint rule, of second order and reversible, so
the energy of free rotation does not drift; the angular momentum is exact. A clump of one sphere is treated as a
single grain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from labkit.bodies.clumps import rotation_matrices
from labkit.engines.kernel.layout import (
    CONTACT_SUMS,
    DAMPING_LOSS,
    SITE_COLUMNS,
    SITE_FORCE,
    SITE_TORQUE,
    SITE_V,
    SITE_W,
    SPEED2,
    WIDTH,
    Arrays,
    V,
    load,
    store,
)
from labkit.engines.kernel.memory import allocate
from labkit.engines.kernel.motion import Flow, Forces, Grain, Motion, accelerate, damped_fraction
from labkit.engines.kernel.tables import PointerTable
from labkit.grains.laws.vectors import ZERO, Vector, cross, dot, transform
from labkit.grains.state import State

ROOM = 1.01  # factor on the speed, because a sphere moves along an arc within a step

# rows of a block of bodies: position, velocity, force, moment, angular momentum, spin in the middle of the step, real
# part and vector of the orientation, principal moments of inertia, mass, energy dissipated by damping
BODY_X, BODY_V, BODY_FORCE, BODY_MOMENT, MOMENTUM, SPIN = (row * WIDTH for row in (0, 3, 6, 9, 12, 15))
REAL, AXIS, INERTIA, MASS, LOSS, BODY_ROWS = (row * WIDTH for row in (18, 19, 22, 25, 26, 27))

# rows of a block with the arrays of labkit.bodies.clumps.Clumps.for_engine: first row, number of rows
MOVING = {
    "clump_body_position": (BODY_X, 3),
    "clump_body_velocity": (BODY_V, 3),
    "clump_orientation": (REAL, 4),
    "clump_angular_momentum": (MOMENTUM, 3),
}
GIVEN = {**MOVING, "clump_inertia": (INERTIA, 3), "clump_mass": (MASS, 1)}


class Bodies(NamedTuple):
    """The clumps of two or more spheres; the kernel updates their motion in place.

    Args:
        first: First member of each body, and the end, (body + 1,).
        member: Grains of the kernel, in the order of the bodies, (member,).
        owner: Body of each member, (member,).
        arm: Centres of the members in the principal axes, (member, 3), in m.
        by_domain: Members sorted by grain, (member,).
        domain_first: First of `by_domain` in each domain, and the end, (domain + 1,).
        blocks: Blocks of WIDTH bodies, (block, BODY_ROWS).
        turns: Rotation of each body from its principal axes, (body, 3, 3).
        arms: Array of a record of motion for each site, with the arm (m) from the centre of its clump as velocity.
    """

    first: np.ndarray
    member: np.ndarray
    owner: np.ndarray
    arm: np.ndarray
    by_domain: np.ndarray
    domain_first: np.ndarray
    blocks: np.ndarray
    turns: np.ndarray
    arms: np.ndarray

    def rows(self, row: int, width: int = 3) -> np.ndarray:
        """Return the values of all bodies, (body, width), in `width` rows starting at `row`."""
        blocks = self.blocks[:, row : row + width * WIDTH].reshape(-1, width, WIDTH)
        return np.moveaxis(blocks, 1, 2).reshape(-1, width)[: len(self.turns)]

    def motion(self) -> dict[str, np.ndarray]:
        """Return the motion of the bodies, named as in labkit.bodies.clumps.Clumps.for_engine."""
        return {name: self.rows(row, width) for name, (row, width) in MOVING.items()}


BODIES = PointerTable(
    Bodies,
    sizes=("bodies", "ends", "members", "domain_ends", "blocks", "sites"),
    first=(int, "ends"),
    member=(int, "members"),
    owner=(int, "members"),
    arm=(float, "members", 3),
    by_domain=(int, "members"),
    domain_first=(int, "domain_ends"),
    blocks=(float, "blocks", BODY_ROWS),
    turns=(float, "bodies", 3, 3),
    arms=("real", "sites", SITE_COLUMNS),
)


def bodies_of(state: State) -> Bodies | None:
    """Return the Bodies of a State, with members in the order of the State; None if all grains are single spheres."""
    if state.bodies is None:
        return None
    given = state.bodies.for_engine(state.scene.density)
    member = np.nonzero(given["clump"] >= 0)[0]
    owner, number = given["clump"][member], len(given["clump_mass"])
    first = np.searchsorted(owner, np.arange(number + 1))
    blocks = np.zeros((-(-number // WIDTH), BODY_ROWS))
    blocks[:, REAL : REAL + WIDTH], blocks[:, INERTIA : MASS + WIDTH] = 1.0, 1.0  # padding in the last block
    block, place = np.divmod(np.arange(number), WIDTH)
    rows = [(row, given[name]) for name, (row, _) in GIVEN.items()]
    for row, values in (*rows, (SPIN, state.angular_velocity[member[first[:-1]]])):
        for k, column in enumerate(values.reshape(number, -1).T):
            blocks[block, row + k * WIDTH + place] = column
    return Bodies(
        first=first.astype(np.int64),
        member=member.astype(np.int64),
        owner=owner.astype(np.int64),
        arm=state.bodies.arm[member],
        by_domain=np.zeros(0, np.int64),
        domain_first=np.zeros(0, np.int64),
        blocks=blocks,
        turns=np.ascontiguousarray(rotation_matrices(given["clump_orientation"])),
        arms=np.zeros((0, SITE_COLUMNS)),
    )


def arrange(bodies: Bodies, number: np.ndarray, arrays: Arrays) -> Bodies:
    """Convert Bodies from the grain indices of the State to those of the kernel.

    Args:
        bodies: Bodies with grain indices of the State.
        number: Index in the kernel of each grain of the State, (grain,).
        arrays: Arrays of the kernel.
    """
    member = number[bodies.member]
    order = np.argsort(member)
    first = np.searchsorted(member[order], arrays.grain_first)
    arms = allocate(arrays.motions.shape, arrays.motions.dtype.type)
    integers = {"member": member, "by_domain": order, "domain_first": first}
    return bodies._replace(**{name: values.astype(np.int64) for name, values in integers.items()}, arms=arms)


def vector(rows: np.ndarray, i: int, column: int = 0) -> Vector:
    """Return the vector in three columns of a row."""
    return Vector(rows[i, column], rows[i, column + 1], rows[i, column + 2])


def write_vector(rows: np.ndarray, i: int, column: int, value: Vector) -> None:
    """Write a vector to three columns of a row."""
    rows[i, column], rows[i, column + 1], rows[i, column + 2] = value


def rotate_vector(real: float, axis: Vector, v: Vector, sign: float) -> Vector:
    """Rotate a vector by a quaternion of any length, from the principal axes (sign 1) or into them (sign -1)."""
    twice = 2.0 / (real * real + dot(axis, axis)) * cross(axis, v)
    return v + sign * real * twice + cross(axis, twice)


def spin_at(real: float, axis: Vector, momentum: Vector, inverse: Vector) -> Vector:
    """Return the angular velocity in the principal axes; `inverse` is 1/I."""
    own = rotate_vector(real, axis, momentum, -1.0)
    return Vector(own.x * inverse.x, own.y * inverse.y, own.z * inverse.z)


def half_turn(
    real: float, axis: Vector, now: float, now_axis: Vector, momentum: Vector, inverse: Vector, dt: float
) -> tuple[float, Vector]:
    """Improve the estimate `now`, `now_axis` of the mid-step orientation of a step that starts at `real`, `axis`."""
    w = spin_at(now, now_axis, momentum, inverse)
    return real - 0.25 * dt * dot(now_axis, w), axis + 0.25 * dt * (now * w + cross(now_axis, w))


def by_inertia(real: float, axis: Vector, v: Vector, inertia: Vector) -> Vector:
    """Return I v in the axes x, y, z; for I^-1 v pass the inverse moments of inertia."""
    return rotate_vector(real, axis, spin_at(real, axis, v, inertia), 1.0)


def damp_moment(T: Vector, b: Vector, w: Vector, dt: float, damping: float) -> tuple[Vector, float]:
    """Return the damped moment and the dissipated power; b is the angular acceleration, w the previous spin."""
    p = Vector(
        damped_fraction(b.x, w.x, dt, damping),
        damped_fraction(b.y, w.y, dt, damping),
        damped_fraction(b.z, w.z, dt, damping),
    )
    removed = Vector(p.x * T.x, p.y * T.y, p.z * T.z)
    return T - removed, dot(removed, w + 0.5 * dt * b)


def move_block_of_bodies(block: np.ndarray, flow: Flow, dt: float, damping: float | None) -> None:
    """Move the bodies of a block by one step. See labkit.engines.kernel.motion."""
    for i in range(WIDTH):
        x, v, momentum = load(block, BODY_X, i), load(block, BODY_V, i), load(block, MOMENTUM, i)
        force, moment, inertia = load(block, BODY_FORCE, i), load(block, BODY_MOMENT, i), load(block, INERTIA, i)
        real, axis = block[REAL + i], load(block, AXIS, i)
        inverse = Vector(1.0 / inertia.x, 1.0 / inertia.y, 1.0 / inertia.z)
        if damping is not None:
            turn = by_inertia(real, axis, moment, inverse)
            moment, lost = damp_moment(moment, turn, load(block, SPIN, i), dt, damping)
            block[LOSS + i] += dt * lost
        a = (1.0 / block[MASS + i]) * force
        v, jump, lost_force = accelerate(Grain(x, v, ZERO), Forces(force, ZERO, a, ZERO), flow, dt, damping)
        block[LOSS + i] += lost_force
        momentum = momentum + dt * moment + by_inertia(real, axis, jump, inertia)
        store(block, BODY_X, i, x + dt * v)
        store(block, BODY_V, i, v)
        store(block, MOMENTUM, i, momentum)
        half, half_axis = half_turn(real, axis, real, axis, momentum, inverse, dt)
        half, half_axis = half_turn(real, axis, half, half_axis, momentum, inverse, dt)
        half, half_axis = half_turn(real, axis, half, half_axis, momentum, inverse, dt)
        half, half_axis = half_turn(real, axis, half, half_axis, momentum, inverse, dt)
        store(block, SPIN, i, rotate_vector(half, half_axis, spin_at(half, half_axis, momentum, inverse), 1.0))
        real, axis = 2.0 * half - real, 2.0 * half_axis - axis
        scale = 1.0 / math.sqrt(real * real + dot(axis, axis))
        block[REAL + i] = scale * real
        store(block, AXIS, i, scale * axis)


def write_rotation(turn: np.ndarray, w: float, axis: Vector) -> None:
    """Write the rotation matrix (3, 3) of a unit quaternion to `turn`."""
    x, y, z = axis
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def domains_of(arrays: Arrays) -> int:
    """Return the number of domains; at least 1, or the compiler would have to report a step of 0."""
    return max(1, len(arrays.contact_first))


def move_bodies(bodies: Bodies, arrays: Arrays, d: int, dt: float, motion: Motion, damping: float | None) -> None:
    """Move the blocks of bodies of domain d (blocks d, d + n, ... with n domains) by one step."""
    for number in range(d, len(bodies.blocks), domains_of(arrays)):
        block = bodies.blocks[number]
        move_block_of_bodies(block, Flow(motion.wanted, motion.before), dt, damping)
        for i in range(min(WIDTH, len(bodies.turns) - number * WIDTH)):
            turn, real, axis = bodies.turns[number * WIDTH + i], block[REAL + i], load(block, AXIS, i)
            write_rotation(turn, real, axis)
            arrays.doubles[d, DAMPING_LOSS] += block[LOSS + i]
            block[LOSS + i] = 0.0


def place_members(bodies: Bodies, arrays: Arrays, d: int, motion: Motion) -> None:
    """Write place and motion of the members in domain d, and update the largest speed relative to the mean field."""
    for k in range(bodies.domain_first[d], bodies.domain_first[d + 1]):
        m = bodies.by_domain[k]
        b, g = bodies.owner[m], bodies.member[m]
        body, i = bodies.blocks[b // WIDTH], b % WIDTH
        r = transform(bodies.turns[b], vector(bodies.arm, m))
        x, spin = load(body, BODY_X, i) + r, load(body, SPIN, i)
        v = load(body, BODY_V, i) + cross(spin, r)
        write_vector(arrays.places, g, 0, x)
        write_vector(arrays.motions, g, SITE_V, v)
        write_vector(arrays.motions, g, SITE_W, spin)
        store(arrays.grains[g // WIDTH], V, g % WIDTH, v)
        c = ROOM * (v - transform(motion.wanted, x))
        arrays.doubles[d, SPEED2] = max(arrays.doubles[d, SPEED2], dot(c, c))


def sum_forces(bodies: Bodies, arrays: Arrays, d: int, dt: float, gradient: np.ndarray | None) -> None:
    """Sum the forces on the bodies of domain d (bodies d, d + n, ...) and clear the forces on their members.

    The work of the cell on the contacts was computed with the branches between spheres. With the branches between
    bodies, each member adds F.(L r), where r is its arm in the axes x, y, z.
    """
    work = 0.0
    for b in range(d, len(bodies.turns), domains_of(arrays)):
        body, i = bodies.blocks[b // WIDTH], b % WIDTH
        x, force, moment = load(body, BODY_X, i), ZERO, ZERO
        for m in range(bodies.first[b], bodies.first[b + 1]):
            g = bodies.member[m]
            r = vector(arrays.places, g) - x
            one, turn = vector(arrays.forces, g, SITE_FORCE), vector(arrays.forces, g, SITE_TORQUE)
            one = Vector(1.0 * one.x, 1.0 * one.y, 1.0 * one.z)  # converts to double precision
            force, moment = force + one, moment + cross(r, one) + turn
            arrays.forces[g, :] = 0.0
            if gradient is not None:
                work += dt * dot(one, transform(gradient, r))
        store(body, BODY_FORCE, i, force)
        store(body, BODY_MOMENT, i, moment)
    if gradient is not None:
        arrays.doubles[d, CONTACT_SUMS] += work


def fill_arms(bodies: Bodies, arrays: Arrays) -> None:
    """Write to each site the vector from the centre of its clump; single grains keep zero."""
    arms, images = bodies.arms, len(arrays.places) - 1 - len(arrays.owner)
    for m in range(len(bodies.member)):
        g, b = bodies.member[m], bodies.owner[m]
        write_vector(arms, g, 0, vector(arrays.places, g) - load(bodies.blocks[b // WIDTH], BODY_X, b % WIDTH))
    for image in range(len(arrays.owner)):
        write_vector(arms, images + image, 0, vector(arms, arrays.owner[image]))
