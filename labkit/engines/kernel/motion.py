"""Motion of grains and cell for all contact laws, as in YADE's NewtonIntegrator with the mean field of the cell.

With the velocity gradients L of this step and L- of the previous step, a time step consists of the following formulas,
in this order:

    v+ = v + dt (a + L- v) + (L - L-) x      x+ = x + dt v+      w+ = w + dt b + spin(L - L-)      H+ = H + dt L H

a = F/m and b = T/I. YADE's local damping multiplies each component by 1 - damping if the component accelerates the
grain and by 1 + damping if it decelerates the grain; the spring-dashpot law has no local damping. With c = v - L x, the
velocity relative to the mean field, the formulas give c+ = c + dt a: only forces change c, and the momentum relative to
the mean field is conserved.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from labkit.engines.kernel.layout import (
    DAMPING_LOSS,
    GRAIN_FORCE,
    GRAIN_TORQUE,
    INVERSE_INERTIA,
    INVERSE_MASS,
    SPEED2,
    V,
    W,
    X,
    load,
    store,
)
from labkit.engines.kernel.tables import PointerTable
from labkit.grains.laws.vectors import Vector, dot, transform
from labkit.servo.formula import det


class Motion(NamedTuple):
    """The cell in which the grains move, and the motion of the cell; the kernel updates both in place.

    Args:
        cell: Cell vectors as columns, (3, 3), in m.
        wanted: Velocity gradient until the next correction, (3, 3), in 1/s.
        before: Velocity gradient of the previous step, (3, 3), in 1/s.
        drift: Velocity that each period adds, L times the cell before its motion, (3, 3), in m/s.
        place: Next row of the plan, and time steps to the next correction, (2,).
        totals: Sums of branch (x) force on the first grain over the contacts, (9,), in N m, at the last correction.
        rates: Working array of the servo, (2, 6).
        matrices: Working array of the servo, (3, 3, 3).
        first_cell: Cell at the last neighbour search, (3, 3), in m.
        back: Inverse of the deformation gradient of the cell since the last search, (3, 3).
        spread: Upper bounds on the distance (m) that any grain has moved since the last search and on the stretch of
            the cell since the last search, (2,).
        largest_diameter: Diameter of the largest grain (m).
        skin: Verlet skin (m).
    """

    cell: np.ndarray
    wanted: np.ndarray
    before: np.ndarray
    drift: np.ndarray
    place: np.ndarray
    totals: np.ndarray
    rates: np.ndarray
    matrices: np.ndarray
    first_cell: np.ndarray
    back: np.ndarray
    spread: np.ndarray
    largest_diameter: float
    skin: float


# the lengths are known only at run time, because compilers spend seconds on unrolling loops of known length
MOTION = PointerTable(
    Motion,
    sizes=("three", "six"),
    **dict.fromkeys(("cell", "wanted", "before", "drift"), (float, "three", "three")),
    place=(int, 2),
    totals=(float, 9),
    rates=(float, 2, "six"),
    matrices=(float, "three", "three", "three"),
    **dict.fromkeys(("first_cell", "back"), (float, "three", "three")),
    spread=(float, 2),
    largest_diameter=(float,),
    skin=(float,),
)


def damped_fraction(acceleration: float, velocity: float, dt: float, damping: float) -> float:
    """Return the fraction of one component of the force that local damping removes."""
    product = acceleration * (velocity + 0.5 * dt * acceleration)
    return damping if product > 0.0 else (-damping if product < 0.0 else 0.0)


def damp(a: Vector, force: Vector, velocity: Vector, dt: float, damping: float) -> tuple[Vector, float]:
    """Return the acceleration after local damping and the dissipated power; for rotation pass the torque as `force`.

    The power is the removed part of the force times the mean velocity during the step, relative to the mean field.
    """
    p = Vector(
        damped_fraction(a.x, velocity.x, dt, damping),
        damped_fraction(a.y, velocity.y, dt, damping),
        damped_fraction(a.z, velocity.z, dt, damping),
    )
    a = Vector(a.x * (1.0 - p.x), a.y * (1.0 - p.y), a.z * (1.0 - p.z))
    return a, dot(Vector(p.x * force.x, p.y * force.y, p.z * force.z), velocity + 0.5 * dt * a)


class Grain(NamedTuple):
    """Position (m), velocity (m/s) and spin (rad/s) of a grain."""

    x: Vector
    v: Vector
    w: Vector


class Forces(NamedTuple):
    """Force (N) and torque (N m) on a grain; a is force/mass, b is torque/(moment of inertia)."""

    force: Vector
    torque: Vector
    a: Vector
    b: Vector


class Flow(NamedTuple):
    """Velocity gradients of this step and of the previous one, (3, 3), in 1/s."""

    L: np.ndarray
    before: np.ndarray


def accelerate(grain: Grain, on: Forces, flow: Flow, dt: float, damping: float | None) -> tuple[Vector, Vector, float]:
    """Return velocity and spin of a grain after a step, and the energy (J) that damping dissipates in the step.

    Args:
        grain: The grain.
        on: Force and torque on the grain.
        flow: Velocity gradients.
        dt: Time step (s).
        damping: Coefficient of local damping, or None.
    """
    x, v, w = grain.x, grain.v, grain.w
    a, b, L, before, lost = on.a, on.b, flow.L, flow.before, 0.0
    if damping is not None:
        a, of_force = damp(a, on.force, v - transform(before, x), dt, damping)
        b, of_torque = damp(b, on.torque, w, dt, damping)
        lost = dt * (of_force + of_torque)
    a = a + transform(before, v)
    jump = Vector(
        (L[0, 0] - before[0, 0]) * x.x + (L[0, 1] - before[0, 1]) * x.y + (L[0, 2] - before[0, 2]) * x.z,
        (L[1, 0] - before[1, 0]) * x.x + (L[1, 1] - before[1, 1]) * x.y + (L[1, 2] - before[1, 2]) * x.z,
        (L[2, 0] - before[2, 0]) * x.x + (L[2, 1] - before[2, 1]) * x.y + (L[2, 2] - before[2, 2]) * x.z,
    )
    spin = Vector(
        0.5 * ((L[2, 1] - before[2, 1]) - (L[1, 2] - before[1, 2])),
        0.5 * ((L[0, 2] - before[0, 2]) - (L[2, 0] - before[2, 0])),
        0.5 * ((L[1, 0] - before[1, 0]) - (L[0, 1] - before[0, 1])),
    )
    return v + (dt * a + jump), w + dt * b + spin, lost


class GrainRows(NamedTuple):
    """Rows of a block of grains (layout.py): velocities, masses, workspace and double-precision workspace."""

    block: np.ndarray
    masses: np.ndarray
    work: np.ndarray
    doubles: np.ndarray


def move_rows(rows: GrainRows, n: int, flow: Flow, dt: float, damping: float | None, energy: bool | None) -> None:
    """Move n grains by one step. The row SPEED2 of `doubles` collects the largest c^2.

    Args:
        rows: Rows of the block of grains.
        n: Number of grains.
        flow: Velocity gradients.
        dt: Time step (s).
        damping: Coefficient of local damping, or None.
        energy: None to omit the energy dissipated by damping.
    """
    block, masses, work, doubles = rows.block, rows.masses, rows.work, rows.doubles
    for i in range(n):
        x, v, w = load(doubles, X, i), load(block, V, i), load(work, W, i)
        force, torque = load(work, GRAIN_FORCE, i), load(work, GRAIN_TORQUE, i)
        a = 1.0 * (masses[INVERSE_MASS + i] * force)  # converts to double precision
        b = 1.0 * (masses[INVERSE_INERTIA + i] * torque)
        v, w, lost = accelerate(Grain(x, v, w), Forces(force, torque, a, b), flow, dt, damping)
        if energy is not None and damping is not None:
            doubles[DAMPING_LOSS + i] += lost
        c = v - transform(flow.L, x)
        speed2 = dot(c, c)
        doubles[SPEED2 + i] = max(doubles[SPEED2 + i], speed2)  # the compiler would turn `if` into a masked store
        store(block, V, i, v)
        store(doubles, X, i, x + dt * v)
        store(work, W, i, w)


def move_cell(motion: Motion, dt: float) -> None:
    """Set `drift` to L H, then the cell H to H + dt L H, in place; the columns of H are the cell vectors."""
    cell, L, drift = motion.cell, motion.wanted, motion.drift
    for i in range(len(L)):
        for j in range(3):
            drift[i, j] = L[i, 0] * cell[0, j] + L[i, 1] * cell[1, j] + L[i, 2] * cell[2, j]
    for j in range(len(L)):
        a, b, c = cell[0, j], cell[1, j], cell[2, j]
        for i in range(3):
            cell[i, j] += dt * (L[i, 0] * a + L[i, 1] * b + L[i, 2] * c)


def pull_back(first_cell: np.ndarray, cell: np.ndarray, back: np.ndarray) -> None:
    """Set `back` (3, 3) to F^-1, where the deformation gradient F maps `first_cell` (3, 3) to `cell` (3, 3)."""
    volume = det(cell)
    three = len(cell)
    for i in range(three):
        for j in range(three):
            total = 0.0
            m, n = (j + 1) % 3, (j + 2) % 3
            for k in range(three):
                o, p = (k + 1) % 3, (k + 2) % 3
                total += first_cell[i, k] * (cell[m, o] * cell[n, p] - cell[m, p] * cell[n, o])
            back[i, j] = total / volume


def must_measure(motion: Motion, dt: float, speed2: float) -> int:
    """Update the bounds on the motion of grains and cell; `speed2` is the largest squared speed (m2/s2).

    Returns 1 if, according to these bounds, a new pair of grains may have become neighbours.
    """
    L, before, spread = motion.wanted, motion.before, motion.spread
    squared = 0.0
    for i in range(len(L)):
        for j in range(3):
            before[i, j] = L[i, j]
            squared += L[i, j] * L[i, j]
    spread[1] /= 1.0 - dt * math.sqrt(squared)
    spread[0] += dt * math.sqrt(speed2) * spread[1]
    if 2.0 * spread[0] > skin_left(motion):
        pull_back(motion.first_cell, motion.cell, motion.back)
        return 1
    return 0


def skin_left(motion: Motion) -> float:
    """Return the part of the Verlet skin (m) that the stretch of the cell has not used up."""
    return motion.skin - motion.largest_diameter * (motion.spread[1] - 1.0)


def distance2(back: np.ndarray, places: np.ndarray, start: np.ndarray, n: int) -> float:
    """Return the largest squared displacement (m2) of n grains since the last search, mapped back to the cell then.

    Args:
        back: Inverse of the deformation gradient of the cell since the last search, (3, 3).
        places: Records of place of the grains.
        start: Positions at the last search, (n, 3), in m.
        n: Number of grains.
    """
    largest = 0.0
    for g in range(n):
        squared = 0.0
        for k in range(3):
            moved = back[k, 0] * places[g, 0] + back[k, 1] * places[g, 1] + back[k, 2] * places[g, 2]
            squared += (moved - start[g, k]) ** 2
        largest = max(largest, squared)
    return largest


def search_is_due(motion: Motion, distance2: float) -> int:
    """Return 1 if a search is needed, given the largest squared displacement of a grain (m2)."""
    motion.spread[0] = math.sqrt(distance2)
    return 1 if 2.0 * motion.spread[0] > 0.9 * skin_left(motion) else 0
