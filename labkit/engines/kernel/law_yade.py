"""Contact forces after YADE: Law2_ScGeom6D_CohFrictPhys_CohesionMoment with Ig2_Sphere_Sphere_ScGeom6D.

Against Eqs. 1-3: no dashpots; the relative velocity of the centres is multiplied by (Ra + Rb)/|d| against
ratcheting; history turns with its contact to first order; kr = kt Ra Rb/4, |M| <= eta min(Ra, Rb) fn.
"""

from __future__ import annotations

from labkit.engines.kernel.layout import (
    CELL_WORK,
    FORCE,
    FRICTION_LOSS,
    HISTORY,
    KN,
    RADIUS_A,
    RADIUS_B,
    ROLLING_LOSS,
    TORQUE_A,
    TORQUE_B,
    VREL,
    WA,
    WB,
    WIDTH,
    D,
    compiled,
)
from labkit.engines.kernel.vectors import cap, cross, dot, length_and_inverse


@compiled
def yade_block(block, work, n, dt, kt_over_kn, friction, rolling, gradient):
    """Forces and torques of n contacts, their history brought forward by dt.

    block, work: rows as in layout.py. friction: mu, or None without tangential forces. rolling: (alphaKr, eta), or
    None without moments. gradient: the velocity gradient (3, 3), or None without energy sums.
    """
    for i in range(n):
        kn, ra, rb = block[KN + i], block[RADIUS_A + i], block[RADIUS_B + i]
        dx, dy, dz = work[D + i], work[D + WIDTH + i], work[D + 2 * WIDTH + i]
        distance, inverse = length_and_inverse(dot(dx, dy, dz, dx, dy, dz))
        overlap = ra + rb - distance
        fn = kn * overlap if overlap >= 0.0 else 0.0
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        fx, fy, fz = -fn * nx, -fn * ny, -fn * nz
        if friction is not None or rolling is not None:
            vx, vy, vz = work[VREL + i], work[VREL + WIDTH + i], work[VREL + 2 * WIDTH + i]
            ax, ay, az = work[WA + i], work[WA + WIDTH + i], work[WA + 2 * WIDTH + i]
            bx, by, bz = work[WB + i], work[WB + WIDTH + i], work[WB + 2 * WIDTH + i]
            # the normal of the last step: the branch vector has moved by vrel dt since
            ox, oy, oz = dx - vx * dt, dy - vy * dt, dz - vz * dt
            before = inverse * (1.5 - 0.5 * dot(ox, oy, oz, ox, oy, oz) * inverse * inverse)  # one Newton step
            ox, oy, oz = ox * before, oy * before, oz * before
            qx, qy, qz = cross(ox, oy, oz, nx, ny, nz)
            angle = 0.5 * dt * dot(ox, oy, oz, ax + bx, ay + by, az + bz)
            ox, oy, oz = angle * ox, angle * oy, angle * oz
            kt = kt_over_kn * kn
            if gradient is not None:
                per_stiffness = 1.0 / (kt * ra * rb)
            tax = tay = taz = tbx = tby = tbz = 0.0
        if friction is not None:
            tx, ty, tz = block[HISTORY + i], block[HISTORY + WIDTH + i], block[HISTORY + 2 * WIDTH + i]
            cx, cy, cz = cross(tx, ty, tz, qx, qy, qz)
            tx, ty, tz = tx - cx, ty - cy, tz - cz
            cx, cy, cz = cross(tx, ty, tz, ox, oy, oz)
            tx, ty, tz = tx - cx, ty - cy, tz - cz
            alpha = (ra + rb) * inverse
            cx, cy, cz = cross(ra * ax + rb * bx, ra * ay + rb * by, ra * az + rb * bz, nx, ny, nz)
            sx, sy, sz = alpha * vx - cx, alpha * vy - cy, alpha * vz - cz
            along = dot(sx, sy, sz, nx, ny, nz)
            grow = kt * dt
            tx += grow * (sx - along * nx)
            ty += grow * (sy - along * ny)
            tz += grow * (sz - along * nz)
            squared = dot(tx, ty, tz, tx, ty, tz)
            scale = cap(squared, friction * fn)
            tx, ty, tz = scale * tx, scale * ty, scale * tz
            block[HISTORY + i], block[HISTORY + WIDTH + i], block[HISTORY + 2 * WIDTH + i] = tx, ty, tz
            fx, fy, fz = fx + tx, fy + ty, fz + tz
            cx, cy, cz = cross(nx, ny, nz, tx, ty, tz)
            arm = ra - 0.5 * overlap
            tax, tay, taz = arm * cx, arm * cy, arm * cz
            arm = rb - 0.5 * overlap
            tbx, tby, tbz = arm * cx, arm * cy, arm * cz
            if gradient is not None:
                work[FRICTION_LOSS + i] += (1.0 - scale) * scale * squared * (ra * rb * per_stiffness)
        if rolling is not None:
            if friction is not None:
                m = HISTORY + 3 * WIDTH
            else:
                m = HISTORY
            tx, ty, tz = block[m + i], block[m + WIDTH + i], block[m + 2 * WIDTH + i]
            cx, cy, cz = cross(tx, ty, tz, qx, qy, qz)
            tx, ty, tz = tx - cx, ty - cy, tz - cz
            cx, cy, cz = cross(tx, ty, tz, ox, oy, oz)
            tx, ty, tz = tx - cx, ty - cy, tz - cz
            sx, sy, sz = bx - ax, by - ay, bz - az
            along = dot(sx, sy, sz, nx, ny, nz)
            kr = rolling[0] * ra * rb * kt
            grow = kr * dt
            tx += grow * (sx - along * nx)
            ty += grow * (sy - along * ny)
            tz += grow * (sz - along * nz)
            squared = dot(tx, ty, tz, tx, ty, tz)
            scale = cap(squared, rolling[1] * min(ra, rb) * fn)
            tx, ty, tz = scale * tx, scale * ty, scale * tz
            block[m + i], block[m + WIDTH + i], block[m + 2 * WIDTH + i] = tx, ty, tz
            tax, tay, taz = tax + tx, tay + ty, taz + tz
            tbx, tby, tbz = tbx - tx, tby - ty, tbz - tz
            if gradient is not None:
                work[ROLLING_LOSS + i] += (1.0 - scale) * scale * squared * (per_stiffness / rolling[0])
        work[FORCE + i], work[FORCE + WIDTH + i], work[FORCE + 2 * WIDTH + i] = fx, fy, fz
        if friction is not None or rolling is not None:
            work[TORQUE_A + i], work[TORQUE_A + WIDTH + i], work[TORQUE_A + 2 * WIDTH + i] = tax, tay, taz
            work[TORQUE_B + i], work[TORQUE_B + WIDTH + i], work[TORQUE_B + 2 * WIDTH + i] = tbx, tby, tbz
        if gradient is not None:
            lx = gradient[0, 0] * dx + gradient[0, 1] * dy + gradient[0, 2] * dz
            ly = gradient[1, 0] * dx + gradient[1, 1] * dy + gradient[1, 2] * dz
            lz = gradient[2, 0] * dx + gradient[2, 1] * dy + gradient[2, 2] * dz
            work[CELL_WORK + i] += dt * dot(fx, fy, fz, lx, ly, lz)
