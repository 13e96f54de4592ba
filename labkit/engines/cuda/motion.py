"""Kernels that move cells and grains; a grain moves by the function of labkit.engines.kernel.motion."""

from __future__ import annotations

import math

from labkit.engines.cuda.arrays import DAMPING_LOSS, DeviceArray, DeviceGrains, States
from labkit.engines.cuda.device import cuda
from labkit.engines.kernel.motion import accelerate, pull_back
from labkit.grains.laws.vectors import Vector, dot, transform


def damping_of(law: DeviceArray, s: int) -> float | None:
    """Coefficient of local damping of state s, or None; labkit.engines.cuda.build replaces this function."""
    return None


def vector(rows: DeviceArray, i: int) -> Vector:
    """The i-th vector of rows (3, n)."""
    return Vector(rows[0, i], rows[1, i], rows[2, i])


def set_vector(rows: DeviceArray, i: int, v: Vector) -> None:
    """Write the i-th vector of rows (3, n)."""
    rows[0, i], rows[1, i], rows[2, i] = v


def start_step(states: States) -> None:
    """Start a step of each state that has steps left and needs neither a search nor a correction: move its cell.

    A grain may have a neighbour missing from its list if it has moved farther, in the cell of the last search, than
    half of the skin less the largest diameter times |F^-1 - 1|, with F the deformation of the cell since then.
    One thread per state.
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
    L, cell = states.used[s], states.cell[s]
    for i in range(3):
        for k in range(3):
            states.drift[s, i, k] = L[i, 0] * cell[0, k] + L[i, 1] * cell[1, k] + L[i, 2] * cell[2, k]
    for i in range(3):
        for k in range(3):
            states.cell[s, i, k] += states.time_step[s] * states.drift[s, i, k]
    stretch = stretch_of(states, s)
    left = states.skin[s] - states.diameter[s] * stretch
    states.limit[s] = 0.25 * left * left if left > 0.0 else 0.0


def stretch_of(states: States, s: int) -> float:
    """Set `back` to F^-1, the inverse of the deformation of a state's cell since its search; return |F^-1 - 1|."""
    pull_back(states.first_cell[s], states.cell[s], states.back[s])
    squared = 0.0
    for i in range(3):
        for j in range(3):
            difference = states.back[s, i, j] - (1.0 if i == j else 0.0)
            squared += difference * difference
    return math.sqrt(squared)


def move(states: States, grains: DeviceGrains) -> None:
    """Move the grains of the running states, and mark states that need a search. One thread per grain."""
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if states.running[s] == 0 or g - states.first[s] >= states.grains[s]:
        return
    dt, damping = states.time_step[s], damping_of(states.law, s)
    x, v, w = vector(grains.position, g), vector(grains.velocity, g), vector(grains.spin, g)
    force, torque = vector(grains.force, g), vector(grains.torque, g)
    a, b = grains.inverse_mass[g] * force, grains.inverse_inertia[g] * torque
    v, w, lost = accelerate(x, v, w, a, b, force, torque, states.used[s], states.previous[s], dt, damping)
    x += dt * v
    grains.energies[DAMPING_LOSS, g] += lost
    set_vector(grains.velocity, g, v)
    set_vector(grains.position, g, x)
    set_vector(grains.spin, g, w)
    moved = transform(states.back[s], x) - vector(grains.start, g)
    if not dot(moved, moved) < states.limit[s]:  # also true for NaN
        states.due[s] = 1
