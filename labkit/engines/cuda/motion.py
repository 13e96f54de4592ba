"""Kernels that move cells and grains; the formulas are those of labkit.engines.kernel.motion, in the same order."""

from __future__ import annotations

import math
from typing import Any

from labkit.engines.cuda.arrays import DAMPING_LOSS, DeviceGrains, States
from labkit.engines.cuda.device import cuda
from labkit.engines.kernel.motion import damped_fraction as compiled_fraction
from labkit.grains.laws.vectors import Vector, dot

damped_fraction = compiled_fraction.py_func


def damping_of(law: Any, s: int) -> Any:
    """Coefficient of local damping of the state s, or None; labkit.engines.cuda.build replaces it."""
    return None


def vector(rows: Any, i: int) -> Vector:
    """The i-th vector of rows (3, n)."""
    return Vector(rows[0, i], rows[1, i], rows[2, i])


def put(rows: Any, i: int, v: Vector) -> None:
    """Write the i-th vector of rows (3, n)."""
    rows[0, i], rows[1, i], rows[2, i] = v


def product(matrices: Any, s: int, v: Vector) -> Vector:
    """Product of the s-th of matrices (n, 3, 3) and a vector."""
    return Vector(
        matrices[s, 0, 0] * v[0] + matrices[s, 0, 1] * v[1] + matrices[s, 0, 2] * v[2],
        matrices[s, 1, 0] * v[0] + matrices[s, 1, 1] * v[1] + matrices[s, 1, 2] * v[2],
        matrices[s, 2, 0] * v[0] + matrices[s, 2, 1] * v[1] + matrices[s, 2, 2] * v[2],
    )


def column(matrices: Any, s: int, k: int) -> Vector:
    """Column k of the s-th of matrices (n, 3, 3)."""
    return Vector(matrices[s, 0, k], matrices[s, 1, k], matrices[s, 2, k])


def start_step(states: States) -> None:
    """Start a step of each state that has steps left and needs neither a search nor a correction: move its cell.

    One thread per state.
    A grain may have a neighbour that is not in its list if it has moved farther, in the cell of the last search, than
    half of the skin less the largest diameter times |F^-1 - 1|, with F the deformation of the cell since then.
    """
    s = cuda.grid(1)
    if s >= len(states.left):
        return
    states.running[s] = 1 if states.left[s] > 0 and states.due[s] == 0 and states.until[s] > 0 else 0
    if states.running[s] == 0:
        return
    states.left[s] -= 1
    states.until[s] -= 1
    for i in range(3):
        for j in range(3):
            states.previous[s, i, j] = states.used[s, i, j]
            states.used[s, i, j] = states.wanted[s, i, j]
    for k in range(3):
        moved = product(states.used, s, column(states.cell, s, k))
        for i in range(3):
            states.drift[s, i, k] = moved[i]
    for i in range(3):
        for k in range(3):
            states.cell[s, i, k] += states.time_step[s] * states.drift[s, i, k]
    stretch = pull_back(states, s)
    left = states.skin[s] - states.diameter[s] * stretch
    states.limit[s] = 0.25 * left * left if left > 0.0 else 0.0


def pull_back(states: States, s: int) -> float:
    """Set back = F^-1, the inverse of the deformation of the cell of a state since its search; return |F^-1 - 1|."""
    h = states.cell
    determinant = 0.0
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        determinant += h[s, 0, k] * (h[s, 1, m] * h[s, 2, n] - h[s, 1, n] * h[s, 2, m])
    squared = 0.0
    for i in range(3):
        for j in range(3):
            total = 0.0
            m, n = (j + 1) % 3, (j + 2) % 3
            for k in range(3):
                o, p = (k + 1) % 3, (k + 2) % 3
                total += states.first_cell[s, i, k] * (h[s, m, o] * h[s, n, p] - h[s, m, p] * h[s, n, o])
            states.back[s, i, j] = total / determinant
            difference = states.back[s, i, j] - (1.0 if i == j else 0.0)
            squared += difference * difference
    return math.sqrt(squared)


def damped(acceleration: Vector, velocity: Vector, load: Vector, dt: float, damping: Any) -> tuple[Vector, float]:
    """Acceleration after local damping, and the energy that damping dissipates in the step, J.

    load: force or torque, N or N m; velocity: without that of the mean field.
    """
    if damping is None:
        return acceleration, 0.0
    p = (
        damped_fraction(acceleration[0], velocity[0], dt, damping),
        damped_fraction(acceleration[1], velocity[1], dt, damping),
        damped_fraction(acceleration[2], velocity[2], dt, damping),
    )
    a = Vector(
        acceleration[0] * (1.0 - p[0]),
        acceleration[1] * (1.0 - p[1]),
        acceleration[2] * (1.0 - p[2]),
    )
    mean = velocity + 0.5 * dt * a  # velocity at mid-step
    return a, dt * dot(Vector(p[0] * load[0], p[1] * load[1], p[2] * load[2]), mean)


def move(states: States, grains: DeviceGrains) -> None:
    """Move the grains of the running states, and mark states that need a search. One thread per grain."""
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if states.running[s] == 0 or g - states.first[s] >= states.grains[s]:
        return
    dt, damping = states.time_step[s], damping_of(states.law, s)
    x, v, w = vector(grains.position, g), vector(grains.velocity, g), vector(grains.spin, g)
    force, torque = vector(grains.force, g), vector(grains.torque, g)
    c = v - product(states.previous, s, x)
    a, lost = damped(grains.inverse_mass[g] * force, c, force, dt, damping)
    b, turned = damped(grains.inverse_inertia[g] * torque, w, torque, dt, damping)
    grains.energies[DAMPING_LOSS, g] += lost + turned
    jump = product(states.used, s, x) - product(states.previous, s, x)
    v += dt * (a + product(states.previous, s, v)) + jump
    x += dt * v
    L, before = states.used, states.previous
    spin = Vector(
        0.5 * (L[s, 2, 1] - before[s, 2, 1] - L[s, 1, 2] + before[s, 1, 2]),
        0.5 * (L[s, 0, 2] - before[s, 0, 2] - L[s, 2, 0] + before[s, 2, 0]),
        0.5 * (L[s, 1, 0] - before[s, 1, 0] - L[s, 0, 1] + before[s, 0, 1]),
    )
    put(grains.velocity, g, v)
    put(grains.position, g, x)
    put(grains.spin, g, w + dt * b + spin)
    moved = product(states.back, s, x) - vector(grains.start, g)
    if not dot(moved, moved) < states.limit[s]:  # or it became NaN
        states.due[s] = 1
