"""The loop over time steps.

Grains and contacts are divided into domains that do not depend on the number of threads, and every sum is taken in a
fixed order: results are bit-identical for any number of threads. A domain contains consecutive grains in spatial order
and the contacts of which they are the first grain. If the second grain of a contact belongs to another domain or lies
in another period, the contact uses an image: a separate site that is copied from the grain after each motion. A
contact therefore needs no periodic shift, and no two domains write to the same site.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from labkit.engines.kernel.bodies import Bodies, arms_of_sites, move_bodies, place_members, sum_forces
from labkit.engines.kernel.compiling import compile_and_keep, compile_callee
from labkit.engines.kernel.contact import block_forces, block_stress
from labkit.engines.kernel.layout import (
    CELL_WORK,
    CONTACT_SUMS,
    GRAIN_FORCE,
    LANES,
    SITE_W,
    WIDTH,
    Arrays,
    V,
    W,
    X,
)
from labkit.engines.kernel.motion import correct, largest_speed, move_block, move_cell, set_back, volume_of
from labkit.engines.kernel.sites import add_to_sites, collect_images, image_sites, read_places, read_sites
from labkit.engines.kernel.transfers import prefetch, put_motions, put_places, take_forces, take_records
from labkit.grains.laws.contact import Features
from labkit.servo.formula import ServoPlan

SINGLE = False  # replaced by labkit.engines.kernel.build for mixed precision
LINE = 64  # bytes per cache line


class Motion(NamedTuple):
    """The cell in which the grains move, and its motion; changed in place.

    Args:
        cell: (3, 3), m.
        wanted: Velocity gradient until the next correction, (3, 3), 1/s.
        before: Velocity gradient of the previous step, (3, 3), 1/s.
        place: Next row of the plan, and time steps to the next correction, (2,).
        totals: Sums of branch (x) force on the first grain over the contacts, (9,), N m, at the last correction.
        rates: Memory of the servo, (2, 6).
        matrices: Memory of the servo, (3, 3, 3).
        first_cell: Cell at the last neighbour search, (3, 3), m.
        spread: Upper bounds on the distance that any grain has moved since that search, m, and on the stretch of the
            cell since then, (2,).
        largest_diameter: m.
        skin: Verlet skin, m.
    """

    cell: np.ndarray
    wanted: np.ndarray
    before: np.ndarray
    place: np.ndarray
    totals: np.ndarray
    rates: np.ndarray
    matrices: np.ndarray
    first_cell: np.ndarray
    spread: np.ndarray
    largest_diameter: float
    skin: float


@compile_callee
def whole_lanes(n: int) -> int:
    """Round n up to a multiple of LANES."""
    return (n + LANES - 1) // LANES * LANES


def domain_contacts(arrays: Arrays, d: int, dt: float, law: Features, gradient: np.ndarray | None) -> None:
    """Compute the contacts of the domain d, whose first contact is a multiple of the block size. See `advance`."""
    work, doubles, last = arrays.work[d], arrays.doubles[d], arrays.contact_last[d]
    for start in range(arrays.contact_first[d], last, WIDTH):
        n = whole_lanes(min(WIDTH, last - start))
        block = arrays.blocks[start // WIDTH]
        line = LINE // block.itemsize
        for i in range(0, len(block) // 2, line):
            prefetch(block, len(block) + i)  # the next block, in two halves so that requests do not queue
        a, b = arrays.pairs[0, start : start + n], arrays.pairs[1, start : start + n]
        read_sites(arrays.places, arrays.motions, a, b, work, law.turning)
        block_forces(block, work, n, dt, law, gradient)
        for i in range(len(block) // 2, len(block), line):
            prefetch(block, len(block) + i)
        add_to_sites(arrays.forces, a, b, work, law.turning)
    if SINGLE and gradient is not None:
        rows = 5 if law.cohesion is not None or law.bond is not None else 4
        for k in range(rows * WIDTH):
            doubles[CONTACT_SUMS + k] += work[CELL_WORK + k]
            work[CELL_WORK + k] = 0.0


@compile_and_keep
def domain_grains(
    arrays: Arrays,
    d: int,
    dt: float,
    L: np.ndarray,
    before: np.ndarray,
    damping: float | None,
    energy: np.ndarray | None,
) -> None:
    """Move the grains of the domain d and update their sites."""
    places, motions, forces = arrays.places, arrays.motions, arrays.forces
    work, doubles, last = arrays.work[d], arrays.doubles[d], arrays.grain_first[d + 1]
    for start in range(arrays.grain_first[d], last, WIDTH):
        n = min(WIDTH, last - start)
        block = arrays.grains[start // WIDTH]
        for i in range(0, n, LANES):
            take_forces(forces, start + i, work, GRAIN_FORCE + i)
            take_records(places, 0, start + i, doubles, X + i)
            take_records(motions, SITE_W, start + i, work, W + i)
        move_block(block, arrays.masses[start // WIDTH], work, doubles, n, dt, L, before, damping, energy)
        for i in range(0, n, LANES):
            put_places(places, start + i, doubles, X + i)
            put_motions(motions, start + i, block, V + i, work, W + i)


@compile_callee
def farthest(places: np.ndarray, start: np.ndarray, back: np.ndarray) -> float:
    """Largest distance of a grain from its position at the last search, in the cell at that time, m.

    Args:
        places: Records of place.
        start: Positions at the last search, (grain, 3), m.
        back: Inverse of the deformation gradient of the cell since the search, (3, 3).
    """
    largest = 0.0
    for g in range(len(start)):
        squared = 0.0
        for k in range(3):
            moved = back[k, 0] * places[g, 0] + back[k, 1] * places[g, 1] + back[k, 2] * places[g, 2]
            squared += (moved - start[g, k]) ** 2
        largest = max(largest, squared)
    return math.sqrt(largest)


@compile_callee
def copy_gradient(L: np.ndarray, gradient: np.ndarray | None) -> None:
    """Copy a velocity gradient (3, 3) to one in the precision of contacts, if there is one."""
    if gradient is not None:
        for i in range(3):
            for j in range(3):
                gradient[i, j] = L[i, j]


@compile_and_keep
def drift_of(cell: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Velocity that a period adds (3, 3), L times the cell before the motion, m/s."""
    drift = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            drift[i, j] = L[i, 0] * cell[0, j] + L[i, 1] * cell[1, j] + L[i, 2] * cell[2, j]
    return drift


@compile_and_keep
def search_is_due(
    motion: Motion, L: np.ndarray, dt: float, speed: np.ndarray, places: np.ndarray, start: np.ndarray
) -> bool:
    """Enter a motion of the cell and of the grains, at speeds of at most `speed` (domain,), in `motion`.

    Returns True if a search is needed because a pair of grains may have become neighbours.
    """
    before, spread = motion.before, motion.spread
    squared = 0.0
    for i in range(3):
        for j in range(3):
            before[i, j] = L[i, j]
            squared += L[i, j] * L[i, j]
    largest = 0.0
    for of_domain in speed:
        largest = max(largest, of_domain)
    spread[1] /= 1.0 - dt * math.sqrt(squared)
    spread[0] += dt * largest * spread[1]
    left = motion.skin - motion.largest_diameter * (spread[1] - 1.0)
    if 2.0 * spread[0] > left:
        back = np.empty((3, 3))
        set_back(motion.first_cell, motion.cell, back)
        spread[0] = farthest(places, start, back)
        return 2.0 * spread[0] > 0.9 * left
    return False


def branch_force(arrays: Arrays, law: Features, totals: np.ndarray, bodies: Bodies | None) -> None:
    """Set `totals` (9,) to the sums of branch (x) force on the first grain over all contacts, N m.

    The dashpot forces are excluded, as in records. The branches of clumps connect their centres.
    """
    arms = None if bodies is None else arms_of_sites(bodies, arrays)
    sums = np.zeros(9 * WIDTH)
    for d in range(len(arrays.contact_first)):
        last = arrays.contact_last[d]
        for start in range(arrays.contact_first[d], last, WIDTH):
            n = min(WIDTH, last - start)
            end = start + whole_lanes(n)
            work = arrays.work[0]
            a, b = arrays.pairs[0, start:end], arrays.pairs[1, start:end]
            if law.cohesion is not None or law.bond is not None:
                read_sites(arrays.places, arrays.motions, a, b, work, None)
            else:
                read_places(arrays.places, a, b, work)
            block_stress(arrays.blocks[start // WIDTH], work, n, law, sums, (a, b), arms)
    for k in range(len(totals)):
        totals[k] = 0.0
        for i in range(len(sums) // len(totals)):  # compilers would unroll a loop of known length, in seconds
            totals[k] += sums[k * WIDTH + i]


def advance(
    steps: int,
    moved_already: bool,
    dt: float,
    plan: ServoPlan,
    motion: Motion,
    arrays: Arrays,
    contact_dt: float,
    law: Features,
    damping: float | None,
    gradient: np.ndarray | None,
    bodies: Bodies | None,
) -> tuple[int, bool]:
    """Run up to `steps` steps of dt, s; return the number completed, and True if a neighbour search is needed.

    If a search is needed, the grains have already been moved for the next step, but its forces have not been computed:
    run the search, then call again with moved_already. Numba compiles the loop without the features that are None.

    Args:
        steps: Maximum number of time steps, at most those left in the plan.
        moved_already: True if the grains were already moved for the first step.
        dt: Time step, s.
        plan: Velocity gradients of the coming steps.
        motion: The cell and its motion.
        arrays: Arrays of the loop.
        contact_dt: dt in the precision of contacts.
        law: Numbers of the contact law.
        damping: Coefficient of local damping, or None.
        gradient: Memory for a velocity gradient in the precision of contacts if energies are summed, else None.
        bodies: The clumps, or None.
    """
    cell, L, before, place = motion.cell, motion.wanted, motion.before, motion.place
    shear, friction, rolling, twisting, dashpots, whole, cohesion, bond, turning = (
        law  # a parallel loop accepts no nested tuples
    )
    domains = len(arrays.contact_first)
    speed = np.empty(domains)
    copy_gradient(L, gradient)
    for step in range(steps):
        if not (moved_already and step == 0):
            if place[1] == 0:
                if plan.controlled == 1:
                    branch_force(arrays, law, motion.totals, bodies)
                volume = volume_of(cell)
                correct(plan, place[0], motion.totals, volume, dt, before, L, motion.rates, motion.matrices)
                place[0], place[1] = place[0] + 1, plan.steps[place[0]]
                copy_gradient(L, gradient)
            place[1] -= 1
            drift = drift_of(cell, L)
            move_cell(cell, L, dt)
            if bodies is not None:
                for d in numba.prange(domains):
                    move_bodies(bodies, arrays, d, dt, L, before, damping)
            for d in numba.prange(domains):
                collect_images(arrays, d)
                domain_grains(arrays, d, dt, L, before, damping, gradient)
                if bodies is not None:
                    place_members(bodies, arrays, d, L)
                image_sites(arrays, d, cell, drift)
                speed[d] = largest_speed(arrays.doubles[d])
            if search_is_due(motion, L, dt, speed, arrays.places, arrays.start):
                return step, True
        for d in numba.prange(domains):
            features = Features(shear, friction, rolling, twisting, dashpots, whole, cohesion, bond, turning)
            domain_contacts(arrays, d, contact_dt, features, gradient)
        if bodies is not None:
            for d in numba.prange(domains):
                collect_images(arrays, d)
            for d in numba.prange(domains):
                sum_forces(bodies, arrays, d, dt, gradient)
    return steps, False
