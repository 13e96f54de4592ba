"""Contact forces after Eqs. 1-3, with dashpots and r* = Ra Rb/(Ra + Rb).

The springs are bounded, |ft| <= mu fn and |M| <= mu_r r* fn with fn = kn delta, and the dashpots act beside them as
long as grains overlap: so that a head-on pair separates with exp(-pi beta/sqrt(1 - beta^2)) of its speed, the
normal force may pull a little just before it does.

History turns with the contact exactly: by the smallest rotation from the last normal to the present one, then about
the normal with the mean spin of the two grains. Increments are taken at the normal halfway (second order in dt).
"""

from __future__ import annotations

import math

from labkit.engines.kernel.layout import (
    CELL_WORK,
    DASHPOT_LOSS,
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
def turned(tx, ty, tz, ox, oy, oz, nx, ny, nz, half_angle):
    """A vector in the plane of the normal o, turned to the plane of n and about n by an angle; its length stays."""
    share = dot(tx, ty, tz, nx, ny, nz) / (1.0 + dot(ox, oy, oz, nx, ny, nz))
    tx, ty, tz = tx - share * (ox + nx), ty - share * (oy + ny), tz - share * (oz + nz)
    square = half_angle * half_angle
    cosine, sine = (1.0 - square) / (1.0 + square), 2.0 * half_angle / (1.0 + square)
    cx, cy, cz = cross(nx, ny, nz, tx, ty, tz)
    return cosine * tx + sine * cx, cosine * ty + sine * cy, cosine * tz + sine * cz


@compiled
def paper_block(block, work, n, dt, kt_over_kn, friction, rolling, dashpots, gradient):
    """Forces and torques of n contacts, their history brought forward by dt.

    block, work: rows as in layout.py. friction: mu, or None without tangential springs. rolling: mu_r, or None
    without moments. dashpots: (2 beta_n, 2 beta_t, density 4/3 pi), or
    None. gradient: the velocity gradient (3, 3), or None without energy sums.
    """
    for i in range(n):
        kn, ra, rb = block[KN + i], block[RADIUS_A + i], block[RADIUS_B + i]
        dx, dy, dz = work[D + i], work[D + WIDTH + i], work[D + 2 * WIDTH + i]
        vx, vy, vz = work[VREL + i], work[VREL + WIDTH + i], work[VREL + 2 * WIDTH + i]
        ax, ay, az = work[WA + i], work[WA + WIDTH + i], work[WA + 2 * WIDTH + i]
        bx, by, bz = work[WB + i], work[WB + WIDTH + i], work[WB + 2 * WIDTH + i]
        distance, inverse = length_and_inverse(dot(dx, dy, dz, dx, dy, dz))
        overlap = ra + rb - distance
        touching = 1.0 if overlap >= 0.0 else 0.0
        spring = touching * kn * overlap
        nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
        # normals of the last step and halfway: the branch vector has moved by vrel dt since
        ox, oy, oz = dx - vx * dt, dy - vy * dt, dz - vz * dt
        before = inverse * (1.5 - 0.5 * dot(ox, oy, oz, ox, oy, oz) * inverse * inverse)  # one Newton step
        ox, oy, oz = ox * before, oy * before, oz * before
        hx, hy, hz = dx - 0.5 * dt * vx, dy - 0.5 * dt * vy, dz - 0.5 * dt * vz
        halfway = inverse * (1.5 - 0.5 * dot(hx, hy, hz, hx, hy, hz) * inverse * inverse)
        hx, hy, hz = hx * halfway, hy * halfway, hz * halfway
        half_angle = 0.25 * dt * dot(nx, ny, nz, ax + bx, ay + by, az + bz)
        # relative velocity of the two grains at the point of contact, halfway
        half_overlap = 0.5 * (overlap + 0.5 * dt * dot(nx, ny, nz, vx, vy, vz))
        arm_a, arm_b = ra - half_overlap, rb - half_overlap
        cx, cy, cz = cross(
            arm_a * ax + arm_b * bx, arm_a * ay + arm_b * by, arm_a * az + arm_b * bz, hx, hy, hz
        )  # fmt: skip
        along = dot(hx, hy, hz, vx, vy, vz)
        sx, sy, sz = vx - along * hx - cx, vy - along * hy - cy, vz - along * hz - cz
        along = dot(nx, ny, nz, sx, sy, sz)
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        approach = -dot(nx, ny, nz, vx, vy, vz)
        kt = kt_over_kn * kn
        fn, gx, gy, gz = spring, 0.0, 0.0, 0.0
        if dashpots is not None:  # Eqs. 1 and 2, viscous part: m* = ma mb/(ma + mb)
            ca, cb = dashpots[2] * ra * ra * ra, dashpots[2] * rb * rb * rb
            root = touching * math.sqrt(ca * cb / (ca + cb) * kn)
            cn, ct = dashpots[0] * root, dashpots[1] * math.sqrt(kt_over_kn) * root
            fn += cn * approach
            gx, gy, gz = ct * sx, ct * sy, ct * sz
            if gradient is not None:
                work[DASHPOT_LOSS + i] += dt * (cn * approach * approach + ct * dot(sx, sy, sz, sx, sy, sz))
        if friction is not None:
            tx, ty, tz = turned(
                block[HISTORY + i], block[HISTORY + WIDTH + i], block[HISTORY + 2 * WIDTH + i],
                ox, oy, oz, nx, ny, nz, half_angle,
            )  # fmt: skip
            grow = kt * dt
            tx, ty, tz = tx + grow * sx, ty + grow * sy, tz + grow * sz
            squared = dot(tx, ty, tz, tx, ty, tz)
            scale = cap(squared, friction * spring)
            tx, ty, tz = scale * tx, scale * ty, scale * tz
            block[HISTORY + i], block[HISTORY + WIDTH + i], block[HISTORY + 2 * WIDTH + i] = tx, ty, tz
            gx, gy, gz = gx + tx, gy + ty, gz + tz
            if gradient is not None:
                work[FRICTION_LOSS + i] += (1.0 - scale) * scale * squared / kt
        fx, fy, fz = gx - fn * nx, gy - fn * ny, gz - fn * nz
        cx, cy, cz = cross(nx, ny, nz, gx, gy, gz)
        arm = ra - 0.5 * overlap
        tax, tay, taz = arm * cx, arm * cy, arm * cz
        arm = rb - 0.5 * overlap
        tbx, tby, tbz = arm * cx, arm * cy, arm * cz
        if rolling is not None:
            if friction is not None:
                m = HISTORY + 3 * WIDTH
            else:
                m = HISTORY
            tx, ty, tz = turned(
                block[m + i], block[m + WIDTH + i], block[m + 2 * WIDTH + i], ox, oy, oz, nx, ny, nz, half_angle
            )
            ux, uy, uz = bx - ax, by - ay, bz - az
            along = dot(ux, uy, uz, nx, ny, nz)
            reduced = ra * rb / (ra + rb)  # r*
            kr = kt * reduced * reduced
            grow = kr * dt
            tx, ty, tz = tx + grow * (ux - along * nx), ty + grow * (uy - along * ny), tz + grow * (uz - along * nz)
            squared = dot(tx, ty, tz, tx, ty, tz)
            scale = cap(squared, rolling * reduced * spring)
            tx, ty, tz = scale * tx, scale * ty, scale * tz
            block[m + i], block[m + WIDTH + i], block[m + 2 * WIDTH + i] = tx, ty, tz
            tax, tay, taz = tax + tx, tay + ty, taz + tz
            tbx, tby, tbz = tbx - tx, tby - ty, tbz - tz
            if gradient is not None:
                work[ROLLING_LOSS + i] += (1.0 - scale) * scale * squared / kr
        work[FORCE + i], work[FORCE + WIDTH + i], work[FORCE + 2 * WIDTH + i] = fx, fy, fz
        work[TORQUE_A + i], work[TORQUE_A + WIDTH + i], work[TORQUE_A + 2 * WIDTH + i] = tax, tay, taz
        work[TORQUE_B + i], work[TORQUE_B + WIDTH + i], work[TORQUE_B + 2 * WIDTH + i] = tbx, tby, tbz
        if gradient is not None:
            lx = gradient[0, 0] * dx + gradient[0, 1] * dy + gradient[0, 2] * dz
            ly = gradient[1, 0] * dx + gradient[1, 1] * dy + gradient[1, 2] * dz
            lz = gradient[2, 0] * dx + gradient[2, 1] * dy + gradient[2, 2] * dz
            work[CELL_WORK + i] += dt * dot(fx, fy, fz, lx, ly, lz)
