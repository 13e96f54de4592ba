"""Blocks of contacts: unpacks rows into numbers, applies the contact law, and writes the results back to rows.

The law is `pair` of a labkit.grains.laws.ContactLaw, a function of scalars. The loop over a block calls it, and the
compiler vectorises that loop. `pair` to `bond_stiffness` and `overlap` are placeholders, which
labkit.engines.kernel.blocks replaces with functions of the law and of the precision.
"""

from __future__ import annotations

import math
from typing import Any as Untyped

import numpy as np

from labkit.engines.kernel.layout import (
    BREAKING_LOSS,
    CELL_WORK,
    DASHPOT_LOSS,
    FORCE,
    FRICTION_LOSS,
    HISTORY,
    RADII,
    RADIUS_A,
    RADIUS_B,
    ROLLING_LOSS,
    SQUARES,
    STIFFNESS,
    TORQUE_A,
    TORQUE_B,
    VREL,
    WA,
    WB,
    WIDTH,
    D,
    load,
    store,
)
from labkit.grains.laws.contact import BondHistory, Contact, Features
from labkit.grains.laws.vectors import ZERO, Vector, dot, length_and_inverse, transform

pair: Untyped = None
spring: Untyped = None
attraction: Untyped = None
bond_radius: Untyped = None
bond_stiffness: Untyped = None


def block_forces(
    block: np.ndarray, work: np.ndarray, n: int, dt: float, law: Features, gradient: np.ndarray | None
) -> None:
    """Compute forces and torques of n contacts and advance their history by dt.

    Args:
        block: Rows of the contacts (layout.py).
        work: Rows of the workspace (layout.py).
        n: Number of contacts.
        dt: Time step, s.
        law: Numbers of the contact law.
        gradient: Velocity gradient, (3, 3), 1/s, or None to omit the energy sums.
    """
    rolls = law.rolling is not None or law.twisting is not None
    moment, links, bond = history_rows(law)
    for i in range(n):
        d = load(work, D, i)
        distance, inverse = length_and_inverse(dot(d, d))
        v = a = b = t = m = ZERO
        if law.turning is not None:
            v, a, b = load(work, VREL, i), load(work, WA, i), load(work, WB, i)
        if law.friction is not None:
            t = load(block, HISTORY, i)
        if rolls:
            m = load(block, moment, i)
        contact = Contact(
            block[STIFFNESS + i],
            work[RADIUS_A + i],
            work[RADIUS_B + i],
            overlap(work, i, distance),
            inverse,
            d,
            inverse * d,
            v,
            a,
            b,
        )
        joined = block[links + i] if law.cohesion is not None else 0.0
        response = pair(
            contact,
            t,
            m,
            dt,
            gradient,
            law.shear,
            law.friction,
            law.rolling,
            law.twisting,
            law.dashpots,
            law.whole,
            law.cohesion,
            law.bond,
            joined,
            load_bond(block, bond, i, law.bond),
        )
        store(work, FORCE, i, response.force)
        if law.turning is not None:
            store(work, TORQUE_A, i, response.torque_a)
            store(work, TORQUE_B, i, response.torque_b)
        if law.friction is not None:
            store(block, HISTORY, i, response.tangential_force)
        if rolls:
            store(block, moment, i, response.rolling_moment)
        if law.cohesion is not None:
            block[links + i] = response.joined
        store_bond(block, bond, i, law.bond, response.bonded)
        if gradient is not None:
            if law.cohesion is not None or law.bond is not None:
                work[BREAKING_LOSS + i] += response.breaking_loss
            if law.friction is not None:
                work[FRICTION_LOSS + i] += response.friction_loss
            if rolls:
                work[ROLLING_LOSS + i] += response.rolling_loss
            if law.dashpots is not None:
                work[DASHPOT_LOSS + i] += response.dashpot_loss
            work[CELL_WORK + i] += dt * dot(response.force, transform(gradient, d))


def history_rows(law: Features) -> tuple[int, int, int]:
    """First rows of the rolling moment, of `joined` and of the bond in a block."""
    moment = HISTORY + 3 * WIDTH if law.friction is not None else HISTORY
    links = moment + 3 * WIDTH if law.rolling is not None or law.twisting is not None else moment
    return moment, links, links + WIDTH if law.cohesion is not None else links


def load_bond(block: np.ndarray, first: int, i: int, bond: tuple[float, ...] | None) -> BondHistory | None:
    """Read the history of the i-th bond from the rows from `first` on."""
    if bond is None:
        return None
    return BondHistory(block[first + i], load(block, first + WIDTH, i), load(block, first + 4 * WIDTH, i))


def store_bond(
    block: np.ndarray, first: int, i: int, bond: tuple[float, ...] | None, history: BondHistory | None
) -> None:
    """Write the history of the i-th bond to the rows from `first` on."""
    if bond is not None and history is not None:
        block[first + i] = history.length
        store(block, first + WIDTH, i, history.force)
        store(block, first + 4 * WIDTH, i, history.moment)


def link_force(
    block: np.ndarray, work: np.ndarray, i: int, depth: float, cohesion: Untyped, bond: Untyped, links: int, first: int
) -> tuple[float, Vector]:
    """Normal force, N, compression positive, and tangential force of cohesion and of the bond of a contact."""
    fn, ft = 0.0, ZERO
    if cohesion is not None and block[links + i] != 0.0:
        fn = attraction(cohesion, block[STIFFNESS + i], work[RADIUS_A + i], work[RADIUS_B + i], depth)
    if bond is not None:
        length = abs(block[first + i])
        if length > 0.0:
            radius = bond_radius(bond, work[RADIUS_A + i], work[RADIUS_B + i])
            fn -= bond_stiffness(bond, radius, length)[0] * (work[RADII + i] - depth - length)
            ft = load(block, first + WIDTH, i)
    return fn, ft


def overlap(work: np.ndarray, i: int, distance: float) -> float:
    """Overlap R - |d| of a contact, m, with the sum R of the radii and the branch d."""
    return work[RADII + i] - distance


def overlap_single(work: np.ndarray, i: int, distance: float) -> float:
    """The same as (R^2 - d^2)/(R + |d|), with the numerator from double precision: accurate to single precision."""
    return work[SQUARES + i] / (work[RADII + i] + distance)


def block_stress(
    block: np.ndarray,
    work: np.ndarray,
    n: int,
    law: Features,
    sums: np.ndarray,
    arms: bool | None,
) -> None:
    """Add branch (x) force on the first grain of n contacts to `sums` (9 WIDTH,).

    The dashpot forces are excluded, as in records. With clumps, `arms` is True and the rows VREL have the arm of the
    second grain in its clump minus that of the first; otherwise it is None.
    """
    _, links, bond = history_rows(law)
    for i in range(n):
        d = load(work, D, i)
        distance = math.sqrt(dot(d, d))
        depth = overlap(work, i, distance)
        share = -spring(block[STIFFNESS + i], depth) / distance if depth >= 0.0 else 0.0
        f = share * d
        if law.cohesion is not None or law.bond is not None:
            fn, ft = link_force(block, work, i, depth, law.cohesion, law.bond, links, bond)
            f += ft - (fn / distance) * d
        if law.friction is not None:
            f += load(block, HISTORY, i)
        if arms is not None:
            d = d - load(work, VREL, i)
        sums[i] += d.x * f.x
        sums[WIDTH + i] += d.x * f.y
        sums[2 * WIDTH + i] += d.x * f.z
        sums[3 * WIDTH + i] += d.y * f.x
        sums[4 * WIDTH + i] += d.y * f.y
        sums[5 * WIDTH + i] += d.y * f.z
        sums[6 * WIDTH + i] += d.z * f.x
        sums[7 * WIDTH + i] += d.z * f.y
        sums[8 * WIDTH + i] += d.z * f.z
