"""Motion of grains and cell for all contact laws, as in YADE's NewtonIntegrator with the mean field of the cell.

Formulas of a step from n to n+1, in order; L is the velocity gradient of this step and L- that of the previous step:

    v+ = v + dt (a + L- v) + (L - L-) x      x+ = x + dt v+      w+ = w + dt b + spin(L - L-)      H+ = H + dt L H

a = F/m and b = T/I. YADE's local damping multiplies each component by 1 - damping if it accelerates the grain and by
1 + damping if it decelerates it; the spring-dashpot law has no local damping. With c = v - L x, the velocity relative
to the mean field, the formulas give c+ = c + dt a: only forces change c, and the momentum relative to the mean
field is conserved.
"""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.kernel.compiling import Version, compile_callee, compile_with_callees
from labkit.engines.kernel.layout import (
    DAMPING_LOSS,
    GRAIN_FORCE,
    GRAIN_TORQUE,
    INVERSE_INERTIA,
    INVERSE_MASS,
    SPEED2,
    WIDTH,
    V,
    W,
    X,
    load,
    store,
)
from labkit.grains.laws.vectors import Vector, dot, transform
from labkit.servo import formula
from labkit.servo.formula import det


def damped_fraction(acceleration: float, velocity: float, dt: float, damping: float) -> float:
    """Fraction of one component that Newton's local damping removes."""
    product = acceleration * (velocity + 0.5 * dt * acceleration)
    return damping if product > 0.0 else (-damping if product < 0.0 else 0.0)


def damp(a: Vector, force: Vector, velocity: Vector, dt: float, damping: float) -> tuple[Vector, float]:
    """Acceleration after local damping, and the power dissipated; for rotation, pass the torque as `force`.

    The power is the removed fraction of the force times the mean velocity during the step, without the mean field.
    """
    p = Vector(
        damped_fraction(a.x, velocity.x, dt, damping),
        damped_fraction(a.y, velocity.y, dt, damping),
        damped_fraction(a.z, velocity.z, dt, damping),
    )
    a = Vector(a.x * (1.0 - p.x), a.y * (1.0 - p.y), a.z * (1.0 - p.z))
    return a, dot(Vector(p.x * force.x, p.y * force.y, p.z * force.z), velocity + 0.5 * dt * a)


def accelerate(
    x: Vector,
    v: Vector,
    w: Vector,
    a: Vector,
    b: Vector,
    force: Vector,
    torque: Vector,
    L: np.ndarray,
    before: np.ndarray,
    dt: float,
    damping: float | None,
) -> tuple[Vector, Vector, float]:
    """Velocity and spin of a grain after a step, and the energy that damping dissipates in it, J.

    Args:
        x: Position, m.
        v: Velocity, m/s.
        w: Spin, rad/s.
        a: Force over mass.
        b: Torque over moment of inertia.
        force: N.
        torque: N m.
        L: Velocity gradient of this step, (3, 3), 1/s.
        before: That of the previous step.
        dt: Time step, s.
        damping: Coefficient of local damping, or None.
    """
    lost = 0.0
    if damping is not None:
        a, of_force = damp(a, force, v - transform(before, x), dt, damping)
        b, of_torque = damp(b, torque, w, dt, damping)
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


def move_rows(
    block: np.ndarray,
    masses: np.ndarray,
    work: np.ndarray,
    doubles: np.ndarray,
    n: int,
    dt: float,
    L: np.ndarray,
    before: np.ndarray,
    damping: float | None,
    energy: np.ndarray | None,
) -> None:
    """Move n grains by one step. The row SPEED2 of `doubles` collects the largest c^2.

    Args:
        block: Rows of the velocity of the grains (layout.py).
        masses: Rows of the masses (layout.py).
        work: Rows of the workspace (layout.py).
        doubles: Rows of the workspace in double precision (layout.py).
        n: Number of grains.
        dt: Time step, s.
        L: Velocity gradient of this step, (3, 3), 1/s.
        before: Velocity gradient of the previous step, (3, 3), 1/s.
        damping: Coefficient of local damping, or None.
        energy: None to omit the energy dissipated by damping.
    """
    for i in range(n):
        x, v, w = load(doubles, X, i), load(block, V, i), load(work, W, i)
        force, torque = load(work, GRAIN_FORCE, i), load(work, GRAIN_TORQUE, i)
        a = 1.0 * (masses[INVERSE_MASS + i] * force)  # in double precision
        b = 1.0 * (masses[INVERSE_INERTIA + i] * torque)
        v, w, lost = accelerate(x, v, w, a, b, force, torque, L, before, dt, damping)
        if energy is not None and damping is not None:
            doubles[DAMPING_LOSS + i] += lost
        c = v - transform(L, x)
        speed2 = dot(c, c)
        doubles[SPEED2 + i] = max(doubles[SPEED2 + i], speed2)  # `if` would make a masked store
        store(block, V, i, v)
        store(doubles, X, i, x + dt * v)
        store(work, W, i, w)


move_block = compile_with_callees(move_rows, {}, Version("motion"))
volume_of = compile_callee(det)
correct = compile_with_callees(formula.correct, {}, Version("servo"), compile_callee)


@compile_callee
def move_cell(cell: np.ndarray, L: np.ndarray, dt: float) -> None:
    """Set H to H + dt L H in place; cell (3, 3) with the cell vectors as columns."""
    for j in range(3):
        a, b, c = cell[0, j], cell[1, j], cell[2, j]
        for i in range(3):
            cell[i, j] += dt * (L[i, 0] * a + L[i, 1] * b + L[i, 2] * c)


def pull_back(first_cell: np.ndarray, cell: np.ndarray, back: np.ndarray) -> None:
    """Set `back` (3, 3) to F^-1, the inverse of the deformation that brought `first_cell` (3, 3) to `cell` (3, 3)."""
    volume = det(cell)
    for i in range(3):
        for j in range(3):
            total = 0.0
            m, n = (j + 1) % 3, (j + 2) % 3
            for k in range(3):
                o, p = (k + 1) % 3, (k + 2) % 3
                total += first_cell[i, k] * (cell[m, o] * cell[n, p] - cell[m, p] * cell[n, o])
            back[i, j] = total / volume


set_back = compile_with_callees(pull_back, {}, Version("motion"), compile_callee)


@compile_callee
def largest_speed(doubles: np.ndarray) -> float:
    """Return the largest |c| of the last motion, m/s, and reset it."""
    largest = 0.0
    for i in range(WIDTH):
        largest = max(largest, doubles[SPEED2 + i])
        doubles[SPEED2 + i] = 0.0
    return math.sqrt(largest)
