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

from labkit.engines.kernel.compiling import compiled
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
)


@compiled
def damped_fraction(acceleration: float, velocity: float, dt: float, damping: float) -> float:
    """Fraction of one component that Newton's local damping removes."""
    product = acceleration * (velocity + 0.5 * dt * acceleration)
    return damping if product > 0.0 else (-damping if product < 0.0 else 0.0)


@compiled
def move_block(
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
    """Move n grains by one step. L, before (3, 3). damping: a number, or None for no damping.

    block, masses, work, doubles: rows as in layout.py. energy: not None to sum the energy dissipated by damping. The
    row SPEED2 of `doubles` collects the largest c^2.
    """
    jxx, jxy, jxz = L[0, 0] - before[0, 0], L[0, 1] - before[0, 1], L[0, 2] - before[0, 2]
    jyx, jyy, jyz = L[1, 0] - before[1, 0], L[1, 1] - before[1, 1], L[1, 2] - before[1, 2]
    jzx, jzy, jzz = L[2, 0] - before[2, 0], L[2, 1] - before[2, 1], L[2, 2] - before[2, 2]
    spin_x, spin_y, spin_z = 0.5 * (jzy - jyz), 0.5 * (jxz - jzx), 0.5 * (jyx - jxy)
    for i in range(n):
        x, y, z = doubles[X + i], doubles[X + WIDTH + i], doubles[X + 2 * WIDTH + i]
        vx, vy, vz = block[V + i], block[V + WIDTH + i], block[V + 2 * WIDTH + i]
        wx, wy, wz = work[W + i], work[W + WIDTH + i], work[W + 2 * WIDTH + i]
        inverse_mass, inverse_inertia = masses[INVERSE_MASS + i], masses[INVERSE_INERTIA + i]
        f, m = GRAIN_FORCE, GRAIN_TORQUE
        fx, fy, fz = work[f + i], work[f + WIDTH + i], work[f + 2 * WIDTH + i]
        mx, my, mz = work[m + i], work[m + WIDTH + i], work[m + 2 * WIDTH + i]
        ax, ay, az = fx * inverse_mass, fy * inverse_mass, fz * inverse_mass
        bx, by, bz = mx * inverse_inertia, my * inverse_inertia, mz * inverse_inertia
        if damping is not None:
            cx = vx - (before[0, 0] * x + before[0, 1] * y + before[0, 2] * z)
            cy = vy - (before[1, 0] * x + before[1, 1] * y + before[1, 2] * z)
            cz = vz - (before[2, 0] * x + before[2, 1] * y + before[2, 2] * z)
            px, py, pz = (
                damped_fraction(ax, cx, dt, damping),
                damped_fraction(ay, cy, dt, damping),
                damped_fraction(az, cz, dt, damping),
            )
            qx, qy, qz = (
                damped_fraction(bx, wx, dt, damping),
                damped_fraction(by, wy, dt, damping),
                damped_fraction(bz, wz, dt, damping),
            )
            ax, ay, az = ax * (1.0 - px), ay * (1.0 - py), az * (1.0 - pz)
            bx, by, bz = bx * (1.0 - qx), by * (1.0 - qy), bz * (1.0 - qz)
            if energy is not None:  # removed fraction of the force times the mean velocity during the step
                h = 0.5 * dt
                lost = px * fx * (cx + h * ax) + py * fy * (cy + h * ay) + pz * fz * (cz + h * az)
                turn = qx * mx * (wx + h * bx) + qy * my * (wy + h * by) + qz * mz * (wz + h * bz)
                doubles[DAMPING_LOSS + i] += dt * (lost + turn)
        ax += before[0, 0] * vx + before[0, 1] * vy + before[0, 2] * vz
        ay += before[1, 0] * vx + before[1, 1] * vy + before[1, 2] * vz
        az += before[2, 0] * vx + before[2, 1] * vy + before[2, 2] * vz
        vx += dt * ax + (jxx * x + jxy * y + jxz * z)
        vy += dt * ay + (jyx * x + jyy * y + jyz * z)
        vz += dt * az + (jzx * x + jzy * y + jzz * z)
        cx = vx - (L[0, 0] * x + L[0, 1] * y + L[0, 2] * z)
        cy = vy - (L[1, 0] * x + L[1, 1] * y + L[1, 2] * z)
        cz = vz - (L[2, 0] * x + L[2, 1] * y + L[2, 2] * z)
        speed2 = cx * cx + cy * cy + cz * cz
        doubles[SPEED2 + i] = speed2 if speed2 > doubles[SPEED2 + i] else doubles[SPEED2 + i]
        block[V + i], block[V + WIDTH + i], block[V + 2 * WIDTH + i] = vx, vy, vz
        doubles[X + i], doubles[X + WIDTH + i], doubles[X + 2 * WIDTH + i] = x + dt * vx, y + dt * vy, z + dt * vz
        work[W + i] = wx + dt * bx + spin_x
        work[W + WIDTH + i] = wy + dt * by + spin_y
        work[W + 2 * WIDTH + i] = wz + dt * bz + spin_z


@compiled
def move_cell(cell: np.ndarray, L: np.ndarray, dt: float) -> None:
    """Set H to H + dt L H in place; cell (3, 3) with the cell vectors as columns."""
    for j in range(3):
        a, b, c = cell[0, j], cell[1, j], cell[2, j]
        for i in range(3):
            cell[i, j] += dt * (L[i, 0] * a + L[i, 1] * b + L[i, 2] * c)


@compiled
def largest_speed(doubles: np.ndarray) -> float:
    """Return the largest |c| of the last motion, m/s, and reset it."""
    largest = 0.0
    for i in range(WIDTH):
        largest = max(largest, doubles[SPEED2 + i])
        doubles[SPEED2 + i] = 0.0
    return math.sqrt(largest)
