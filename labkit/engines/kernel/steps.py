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

from labkit.engines.kernel.compiling import compiled, kept
from labkit.engines.kernel.contact import block_forces, block_stress
from labkit.engines.kernel.layout import (
    CELL_WORK,
    CONTACT_SUMS,
    GRAIN_FORCE,
    LANES,
    SITE_W,
    WIDTH,
    V,
    W,
    X,
)
from labkit.engines.kernel.motion import largest_speed, move_block, move_cell
from labkit.engines.kernel.sites import add_to_sites, collect_images, image_sites, read_places, read_sites
from labkit.engines.kernel.transfers import prefetch, put_motions, put_places, take_forces, take_records
from labkit.grains.laws.contact import Features

SINGLE = False  # replaced by labkit.engines.kernel.build for mixed precision
LINE = 64  # bytes per cache line


class Arrays(NamedTuple):
    """Arrays of the loop; see layout.py for the rows and columns.

    grain_first (domain + 1,), contact_first, contact_last (domain,): first and last grains and contacts of each domain;
    places, motions, forces: records of grains and images; grains, masses, blocks: blocks of grains and of contacts;
    pairs (2, contact): sites of a contact; image_first (domain + 1,), owner (image,), shift (image, 3): first image of
    each domain, the grain that an image copies, and its periodic shift; work, doubles (domain, ...): workspaces; start
    (grain, 3): positions at the last neighbour search, m.
    """

    grain_first: np.ndarray
    contact_first: np.ndarray
    contact_last: np.ndarray
    places: np.ndarray
    motions: np.ndarray
    forces: np.ndarray
    grains: np.ndarray
    masses: np.ndarray
    image_first: np.ndarray
    owner: np.ndarray
    shift: np.ndarray
    pairs: np.ndarray
    blocks: np.ndarray
    work: np.ndarray
    doubles: np.ndarray
    start: np.ndarray


class Motion(NamedTuple):
    """The cell in which the grains move, and its motion; changed in place.

    cell (3, 3), m; before (3, 3): velocity gradient of the previous step, 1/s; first_cell (3, 3), m: cell at the last
    neighbour search; spread (2,): upper bounds on the distance that any grain has moved since that search, m, and on
    the stretch of the cell since then; largest_diameter, skin: m.
    """

    cell: np.ndarray
    before: np.ndarray
    first_cell: np.ndarray
    spread: np.ndarray
    largest_diameter: float
    skin: float


@compiled
def whole_lanes(n: int) -> int:
    """Round n up to a multiple of LANES."""
    return (n + LANES - 1) // LANES * LANES


def domain_contacts(
    places: np.ndarray,
    motions: np.ndarray,
    forces: np.ndarray,
    pairs: np.ndarray,
    blocks: np.ndarray,
    work: np.ndarray,
    doubles: np.ndarray,
    first: int,
    last: int,
    dt: float,
    law: Features,
    gradient: np.ndarray | None,
) -> None:
    """Compute the contacts first <= k < last of a domain; `first` is a multiple of the block size. See `advance`."""
    for start in range(first, last, WIDTH):
        n = whole_lanes(min(WIDTH, last - start))
        block = blocks[start // WIDTH]
        line = LINE // block.itemsize
        for i in range(0, len(block) // 2, line):
            prefetch(block, len(block) + i)  # the next block, in two halves so that requests do not queue
        a, b = pairs[0, start : start + n], pairs[1, start : start + n]
        read_sites(places, motions, a, b, work, law.turning)
        block_forces(block, work, n, dt, law, gradient)
        for i in range(len(block) // 2, len(block), line):
            prefetch(block, len(block) + i)
        add_to_sites(forces, a, b, work, law.turning)
    if SINGLE and gradient is not None:
        for k in range(4 * WIDTH):
            doubles[CONTACT_SUMS + k] += work[CELL_WORK + k]
            work[CELL_WORK + k] = 0.0


@kept
def domain_grains(
    places: np.ndarray,
    motions: np.ndarray,
    forces: np.ndarray,
    grains: np.ndarray,
    masses: np.ndarray,
    work: np.ndarray,
    doubles: np.ndarray,
    first: int,
    last: int,
    dt: float,
    L: np.ndarray,
    before: np.ndarray,
    damping: float | None,
    energy: np.ndarray | None,
) -> None:
    """Move the grains first <= g < last and update their sites."""
    for start in range(first, last, WIDTH):
        n = min(WIDTH, last - start)
        block = grains[start // WIDTH]
        for i in range(0, n, LANES):
            take_forces(forces, start + i, work, GRAIN_FORCE + i)
            take_records(places, 0, start + i, doubles, X + i)
            take_records(motions, SITE_W, start + i, work, W + i)
        move_block(block, masses[start // WIDTH], work, doubles, n, dt, L, before, damping, energy)
        for i in range(0, n, LANES):
            put_places(places, start + i, doubles, X + i)
            put_motions(motions, start + i, block, V + i, work, W + i)


@compiled
def farthest(places: np.ndarray, start: np.ndarray, back: np.ndarray) -> float:
    """Largest distance of a grain from its position `start` (grain, 3) at the last search, in the cell at that time, m.

    back (3, 3): inverse of the deformation gradient of the cell since the search.
    """
    largest = 0.0
    for g in range(len(start)):
        squared = 0.0
        for k in range(3):
            moved = back[k, 0] * places[g, 0] + back[k, 1] * places[g, 1] + back[k, 2] * places[g, 2]
            squared += (moved - start[g, k]) ** 2
        largest = max(largest, squared)
    return math.sqrt(largest)


@kept
def drift_of(cell: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Velocity that a period adds (3, 3), L times the cell before the motion, m/s."""
    return L @ cell


@kept
def search_is_due(
    motion: Motion, L: np.ndarray, dt: float, speed: np.ndarray, places: np.ndarray, start: np.ndarray
) -> bool:
    """Enter a motion of the cell and of the grains, at speeds of at most `speed` (domain,), in `motion`.

    Return True if a pair of grains may have become neighbours, so that a search is needed.
    """
    before, spread = motion.before, motion.spread
    for i in range(3):
        for j in range(3):
            before[i, j] = L[i, j]
    spread[1] /= 1.0 - dt * math.sqrt((L * L).sum())
    spread[0] += dt * speed.max() * spread[1]
    left = motion.skin - motion.largest_diameter * (spread[1] - 1.0)
    if 2.0 * spread[0] > left:
        back = motion.first_cell @ np.linalg.inv(motion.cell)
        spread[0] = farthest(places, start, back)
        return 2.0 * spread[0] > 0.9 * left
    return False


def advance(
    steps: int,
    moved_already: bool,
    dt: float,
    L: np.ndarray,
    motion: Motion,
    arrays: Arrays,
    contact_dt: float,
    law: Features,
    damping: float | None,
    gradient: np.ndarray | None,
) -> tuple[int, bool]:
    """Run up to `steps` steps of dt, s; return the number completed, and True if a neighbour search is needed.

    If a search is needed, the grains have already been moved for the next step, but its forces have not been computed:
    run the search, then call again with moved_already. L (3, 3): velocity gradient, 1/s; contact_dt, gradient: dt, and
    L if energies are summed, else None, in the precision of contacts; law: numbers of the contact law; damping:
    coefficient of local damping. Numba compiles the loop without the features that are None.
    """
    grain_first, contact_first, contact_last = arrays.grain_first, arrays.contact_first, arrays.contact_last
    places, motions, forces = arrays.places, arrays.motions, arrays.forces
    grains, masses, work, doubles = arrays.grains, arrays.masses, arrays.work, arrays.doubles
    image_first, owner, shift = arrays.image_first, arrays.owner, arrays.shift
    pairs, blocks, start = arrays.pairs, arrays.blocks, arrays.start
    cell, before = motion.cell, motion.before
    shear, friction, rolling, twisting, dashpots, whole, turning = law  # a parallel loop takes no tuples in a tuple
    domains = len(contact_first)
    speed = np.empty(domains)
    for step in range(steps):
        if not (moved_already and step == 0):
            drift = drift_of(cell, L)
            move_cell(cell, L, dt)
            for d in numba.prange(domains):
                first, last = image_first[d], image_first[d + 1]
                collect_images(forces, owner, first, last)
                domain_grains(
                    places,
                    motions,
                    forces,
                    grains,
                    masses,
                    work[d],
                    doubles[d],
                    grain_first[d],
                    grain_first[d + 1],
                    dt,
                    L,
                    before,
                    damping,
                    gradient,
                )
                image_sites(places, motions, owner, first, last, shift, cell, drift)
                speed[d] = largest_speed(doubles[d])
            if search_is_due(motion, L, dt, speed, places, start):
                return step, True
        for d in numba.prange(domains):
            domain_contacts(
                places,
                motions,
                forces,
                pairs,
                blocks,
                work[d],
                doubles[d],
                contact_first[d],
                contact_last[d],
                contact_dt,
                Features(shear, friction, rolling, twisting, dashpots, whole, turning),
                gradient,
            )
    return steps, False


def branch_force(arrays: Arrays, law: Features) -> np.ndarray:
    """Sum of branch (x) force on the first grain over all contacts, (3, 3), N m.

    The dashpot forces are excluded, as in records.
    """
    sums = np.zeros(9 * WIDTH)
    for d in range(len(arrays.contact_first)):
        last = arrays.contact_last[d]
        for start in range(arrays.contact_first[d], last, WIDTH):
            n = min(WIDTH, last - start)
            end = start + whole_lanes(n)
            work = arrays.work[0]
            read_places(arrays.places, arrays.pairs[0, start:end], arrays.pairs[1, start:end], work)
            block_stress(arrays.blocks[start // WIDTH], work, n, law, sums)
    total = np.zeros((3, 3))
    for k in range(9):
        for i in range(WIDTH):
            total[k // 3, k % 3] += sums[k * WIDTH + i]
    return total
