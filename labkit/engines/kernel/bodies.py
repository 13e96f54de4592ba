"""Rigid clumps: sums forces and moments of their spheres, moves the bodies, and places the spheres.

The spheres of a clump are grains of the kernel like any other, but move_rows finds no force on them, and `place` then
writes their position, velocity and spin. L and L- are those of labkit.engines.kernel.motion. With the angular momentum
l, the moment T and the rotation R(q) from the principal axes, in which I is diagonal, a step is

    l+ = l + dt T + I spin(L - L-)      q' = q + dt/4 q' w(q')      q+ = 2 q' - q      w(q) = I^-1 R(q)^T l+

q' is the orientation at half the step: the rotation is the implicit midpoint rule, of second order and reversible, so
that the energy of free rotation has no drift; the angular momentum is exact. A clump of one sphere is a grain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from labkit.engines.kernel.compiling import Function, Version, compile_plain, compile_with_callees
from labkit.engines.kernel.layout import (
    CONTACT_SUMS,
    DAMPING_LOSS,
    SITE_FORCE,
    SITE_TORQUE,
    SITE_V,
    SITE_W,
    SPEED2,
    WIDTH,
    Arrays,
    V,
)
from labkit.engines.kernel.motion import accelerate, damped_fraction
from labkit.grains.laws.vectors import ZERO, Vector, cross, dot, transform
from labkit.grains.state import State

ROUNDS = 4  # of the fixed-point iteration for q', which converges by the factor |w| dt/4
ROOM = 1.01  # on the speed: within a step, a sphere moves along an arc


_KNOWN: dict[Function, Function] = {}


def compiled(function: Function) -> Function:
    """Compile a function together with those that it calls; a decorator."""
    return compile_with_callees(function, _KNOWN, Version("bodies"), compile_plain)


class Bodies(NamedTuple):
    """The clumps of two or more spheres; the motion is changed in place.

    Args:
        first: First member of each body, and the end, (body + 1,).
        member: Grains of the kernel, in the order of the bodies, (member,).
        owner: Body of each member, (member,).
        arm: Centres of the members in the principal axes, (member, 3), m.
        by_domain: Members sorted by grain, (member,).
        domain_first: First of `by_domain` in each domain, and the end, (domain + 1,).
        mass: (body,), kg.
        inertia: Principal moments, (body, 3), kg m2.
        position: (body, 3), m.
        velocity: (body, 3), m/s.
        orientation: Quaternions, (body, 4).
        momentum: Angular momentum, (body, 3), kg m2/s.
        spin: Angular velocity at half a step, (body, 3), rad/s.
        force: Force and moment on each body, (body, 6), N and N m.
    """

    first: np.ndarray
    member: np.ndarray
    owner: np.ndarray
    arm: np.ndarray
    by_domain: np.ndarray
    domain_first: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    orientation: np.ndarray
    momentum: np.ndarray
    spin: np.ndarray
    force: np.ndarray


def bodies_of(state: State) -> Bodies | None:
    """Return the Bodies of a State, with members in its own order, or None if all of its grains are single spheres."""
    clumps = state.clumps
    if clumps is None or clumps.single.all():
        return None
    several = ~clumps.single
    member = np.nonzero(several[clumps.body])[0]
    number = np.cumsum(several) - 1
    owner = number[clumps.body[member]]
    density, rows = state.scene.density, np.nonzero(several)[0]
    return Bodies(
        first=np.searchsorted(owner, np.arange(len(rows) + 1)),
        member=member,
        owner=owner,
        arm=clumps.arm[member],
        by_domain=np.zeros(0, np.int64),
        domain_first=np.zeros(0, np.int64),
        mass=density * clumps.body_volume[rows],
        inertia=density * clumps.body_inertia[rows],
        position=clumps.body_position[rows],
        velocity=clumps.body_velocity[rows],
        orientation=clumps.orientation[rows],
        momentum=clumps.angular_momentum[rows],
        spin=state.angular_velocity[clumps.first[rows]],
        force=np.zeros((len(rows), 6)),
    )


def arranged(bodies: Bodies, number: np.ndarray, grain_first: np.ndarray) -> Bodies:
    """Return Bodies, whose members are numbered as in the State, for the order of the kernel.

    Args:
        bodies: The Bodies.
        number: Grain of the kernel of each grain of the State, (grain,).
        grain_first: First grain of each domain, and the end, (domain + 1,).
    """
    member = number[bodies.member]
    order = np.argsort(member)
    return bodies._replace(member=member, by_domain=order, domain_first=np.searchsorted(member[order], grain_first))


def vector(rows: np.ndarray, i: int, column: int = 0) -> Vector:
    """Read three columns of a row."""
    return Vector(rows[i, column], rows[i, column + 1], rows[i, column + 2])


def put(rows: np.ndarray, i: int, column: int, value: Vector) -> None:
    """Write three columns of a row."""
    rows[i, column], rows[i, column + 1], rows[i, column + 2] = value


def turned(q: np.ndarray, v: Vector, sign: float) -> Vector:
    """Rotate a vector by a quaternion of any length, from the principal axes (sign 1) or into them (sign -1)."""
    axis = Vector(q[1], q[2], q[3])
    twice = 2.0 / (q[0] * q[0] + dot(axis, axis)) * cross(axis, v)
    return v + sign * q[0] * twice + cross(axis, twice)


def spin_at(q: np.ndarray, momentum: Vector, inertia: Vector) -> Vector:
    """Angular velocity in the principal axes at an orientation."""
    own = turned(q, momentum, -1.0)
    return Vector(own.x / inertia.x, own.y / inertia.y, own.z / inertia.z)


def rotate(q: np.ndarray, half: np.ndarray, momentum: Vector, inertia: Vector, dt: float) -> Vector:
    """Turn the orientation q (4,) by one step, in place; return the spin in the middle of the step.

    `half` (4,) receives the orientation there.
    """
    for k in range(4):
        half[k] = q[k]
    for _ in range(ROUNDS):
        w = spin_at(half, momentum, inertia)
        a, b, c, d = half[0], half[1], half[2], half[3]
        half[0] = q[0] + 0.25 * dt * (-b * w.x - c * w.y - d * w.z)
        half[1] = q[1] + 0.25 * dt * (a * w.x + c * w.z - d * w.y)
        half[2] = q[2] + 0.25 * dt * (a * w.y + d * w.x - b * w.z)
        half[3] = q[3] + 0.25 * dt * (a * w.z + b * w.y - c * w.x)
    spin = turned(half, spin_at(half, momentum, inertia), 1.0)
    squared = 0.0
    for k in range(4):
        q[k] = 2.0 * half[k] - q[k]
        squared += q[k] * q[k]
    length = math.sqrt(squared)
    for k in range(4):
        q[k] /= length
    return spin


def by_inertia(q: np.ndarray, v: Vector, inertia: Vector, power: float) -> Vector:
    """Return I v (power 1) or I^-1 v (power -1) in space."""
    own = turned(q, v, -1.0)
    if power > 0.0:
        return turned(q, Vector(own.x * inertia.x, own.y * inertia.y, own.z * inertia.z), 1.0)
    return turned(q, Vector(own.x / inertia.x, own.y / inertia.y, own.z / inertia.z), 1.0)


def damp_moment(T: Vector, b: Vector, w: Vector, dt: float, damping: float) -> tuple[Vector, float]:
    """Moment after local damping, and the power dissipated; b is the angular acceleration, w the spin before it."""
    p = Vector(
        damped_fraction(b.x, w.x, dt, damping),
        damped_fraction(b.y, w.y, dt, damping),
        damped_fraction(b.z, w.z, dt, damping),
    )
    removed = Vector(p.x * T.x, p.y * T.y, p.z * T.z)
    return T - removed, dot(removed, w + 0.5 * dt * b)


def move_body(
    bodies: Bodies, b: int, half: np.ndarray, dt: float, L: np.ndarray, before: np.ndarray, damping: float | None
) -> float:
    """Move a body by one step; return the energy dissipated by damping, J. See labkit.engines.kernel.motion."""
    x, v, momentum = vector(bodies.position, b), vector(bodies.velocity, b), vector(bodies.momentum, b)
    force, moment = vector(bodies.force, b), vector(bodies.force, b, 3)
    inertia, q, lost = vector(bodies.inertia, b), bodies.orientation[b], 0.0
    if damping is not None:
        turn = by_inertia(q, moment, inertia, -1.0)
        moment, lost = damp_moment(moment, turn, vector(bodies.spin, b), dt, damping)
    a = (1.0 / bodies.mass[b]) * force
    v, jump, of_force = accelerate(x, v, ZERO, a, ZERO, force, ZERO, L, before, dt, damping)
    momentum = momentum + dt * moment + by_inertia(q, jump, inertia, 1.0)
    put(bodies.position, b, 0, x + dt * v)
    put(bodies.velocity, b, 0, v)
    put(bodies.momentum, b, 0, momentum)
    put(bodies.spin, b, 0, rotate(q, half, momentum, inertia, dt))
    return of_force + dt * lost


@compiled
def move_bodies(
    bodies: Bodies, arrays: Arrays, d: int, dt: float, L: np.ndarray, before: np.ndarray, damping: float | None
) -> None:
    """Move every n-th body by one step, from the d-th on, of n domains."""
    half, lost = np.empty(4), 0.0
    for b in range(d, len(bodies.mass), len(arrays.contact_first)):
        lost += move_body(bodies, b, half, dt, L, before, damping)
    arrays.doubles[d, DAMPING_LOSS] += lost


@compiled
def place_members(bodies: Bodies, arrays: Arrays, d: int, L: np.ndarray) -> None:
    """Write place and motion of the members in the domain d, and enter their speeds relative to the mean field."""
    for k in range(bodies.domain_first[d], bodies.domain_first[d + 1]):
        m = bodies.by_domain[k]
        b, g = bodies.owner[m], bodies.member[m]
        r = turned(bodies.orientation[b], vector(bodies.arm, m), 1.0)
        x, spin = vector(bodies.position, b) + r, vector(bodies.spin, b)
        v = vector(bodies.velocity, b) + cross(spin, r)
        put(arrays.places, g, 0, x)
        put(arrays.motions, g, SITE_V, v)
        put(arrays.motions, g, SITE_W, spin)
        block, i = arrays.grains[g // WIDTH], V + g % WIDTH
        block[i], block[i + WIDTH], block[i + 2 * WIDTH] = v
        c = ROOM * (v - transform(L, x))
        arrays.doubles[d, SPEED2] = max(arrays.doubles[d, SPEED2], dot(c, c))


@compiled
def sum_forces(bodies: Bodies, arrays: Arrays, d: int, dt: float, gradient: np.ndarray | None) -> None:
    """Sum the forces on every n-th body, from the d-th on, of n domains, and take them from its members.

    The work of the cell on the contacts was that along the branches of the spheres; along those of the bodies it is
    larger by F.(L r) of each member with its arm r in space.
    """
    work = 0.0
    for b in range(d, len(bodies.mass), len(arrays.contact_first)):
        x, force, moment = vector(bodies.position, b), ZERO, ZERO
        for m in range(bodies.first[b], bodies.first[b + 1]):
            g = bodies.member[m]
            r = vector(arrays.places, g) - x
            one, turn = vector(arrays.forces, g, SITE_FORCE), vector(arrays.forces, g, SITE_TORQUE)
            one = Vector(1.0 * one.x, 1.0 * one.y, 1.0 * one.z)  # in double precision
            force, moment = force + one, moment + cross(r, one) + turn
            arrays.forces[g, :] = 0.0
            if gradient is not None:
                work += dt * dot(one, transform(gradient, r))
        put(bodies.force, b, 0, force)
        put(bodies.force, b, 3, moment)
    if gradient is not None:
        arrays.doubles[d, CONTACT_SUMS] += work


@compiled
def arms_of_sites(bodies: Bodies, arrays: Arrays) -> np.ndarray:
    """Vector from the centre of its clump to each site, (site, 3), m; zero for other grains."""
    sites = len(arrays.places)
    arms, images = np.zeros((sites, 3), arrays.motions.dtype), sites - 1 - len(arrays.owner)
    for m in range(len(bodies.member)):
        g = bodies.member[m]
        put(arms, g, 0, vector(arrays.places, g) - vector(bodies.position, bodies.owner[m]))
    for image in range(len(arrays.owner)):
        arms[images + image] = arms[arrays.owner[image]]
    return arms
