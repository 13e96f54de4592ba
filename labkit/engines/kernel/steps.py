"""The loop over time steps.

Grains and contacts are divided into domains that do not depend on the number of threads, and every sum is taken in a
fixed order: results are bit-identical for any number of threads. A domain contains consecutive grains in spatial order
and the contacts of which they are the first grain. If the second grain of a contact belongs to another domain or lies
in another period, the contact uses an image: a separate site that is copied from the grain after each motion. A
contact therefore needs no periodic shift, and no two domains write to the same site.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy import uint64 as uint  # an index that cannot be negative: Numba then leaves out its check

from labkit.engines.kernel.compiling import compiled, kept
from labkit.engines.kernel.contact import block_forces, block_stress
from labkit.engines.kernel.lanes import add, add_opposite, prefetch, put, read, read_difference, take
from labkit.engines.kernel.layout import (
    FORCE,
    FORCE_COLUMNS,
    GRAIN_FORCE,
    LANES,
    SITE_FORCE,
    SITE_TORQUE,
    SITE_V,
    SITE_W,
    SITE_X,
    TORQUE_A,
    TORQUE_B,
    VREL,
    WA,
    WB,
    WIDTH,
    D,
    V,
    W,
    X,
)
from labkit.engines.kernel.motion import largest_speed, move_block, move_cell


class Arrays(NamedTuple):
    """Arrays of the loop; see layout.py for the rows and columns.

    grain_first (domain + 1,), contact_first, contact_last (domain,): first and last grains and contacts of each domain;
    sites, forces: records of grains and images; grains, blocks: blocks of grains and of contacts; pairs (2, contact):
    sites of a contact; image_first (domain + 1,), owner (image,), shift (image, 3): first image of each domain, the
    grain that an image copies, and its periodic shift; work (domain, ...): workspaces; start (grain, 3): positions at
    the last neighbour search, m.
    """

    grain_first: np.ndarray
    contact_first: np.ndarray
    contact_last: np.ndarray
    sites: np.ndarray
    forces: np.ndarray
    grains: np.ndarray
    image_first: np.ndarray
    owner: np.ndarray
    shift: np.ndarray
    pairs: np.ndarray
    blocks: np.ndarray
    work: np.ndarray
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
    """Round n up to whole vectors of LANES numbers."""
    return (n + LANES - 1) // LANES * LANES


@kept
def read_sites(
    sites: np.ndarray, first: np.ndarray, second: np.ndarray, work: np.ndarray, turning: bool | None
) -> None:
    """Fill the rows D to WB of contacts from the sites of their grains; without velocities if `turning` is None."""
    for i in range(0, len(first), LANES):
        read_difference(sites, SITE_X, first, second, i, work, D + i)
        if turning is not None:
            read_difference(sites, SITE_V, first, second, i, work, VREL + i)
            read(sites, SITE_W, first, i, work, WA + i)
            read(sites, SITE_W, second, i, work, WB + i)


@kept
def add_forces(
    forces: np.ndarray, first: np.ndarray, second: np.ndarray, work: np.ndarray, turning: bool | None
) -> None:
    """Add forces and torques of contacts to the sites of their grains."""
    for i in range(0, len(first), LANES):
        add_opposite(forces, SITE_FORCE, first, second, i, work, FORCE + i)
        if turning is not None:
            add(forces, SITE_TORQUE, first, i, work, TORQUE_A + i)
            add(forces, SITE_TORQUE, second, i, work, TORQUE_B + i)


def domain_contacts(
    sites: np.ndarray,
    forces: np.ndarray,
    pairs: np.ndarray,
    blocks: np.ndarray,
    work: np.ndarray,
    first: int,
    last: int,
    dt: float,
    constants: tuple[float, ...],
    friction: Any,
    rolling: Any,
    dashpots: Any,
    gradient: np.ndarray | None,
    turning: bool | None,
) -> None:
    """Compute the contacts first <= k < last of a domain; `first` is a multiple of the block size. See `advance`."""
    for start in range(first, last, WIDTH):
        n = whole_lanes(min(WIDTH, last - start))
        block = blocks[start // WIDTH]
        for i in range(0, len(block) // 2, LANES):
            prefetch(block, len(block) + i)  # the next block, in two halves so that requests do not queue
        a, b = pairs[0, start : start + n], pairs[1, start : start + n]
        read_sites(sites, a, b, work, turning)
        block_forces(block, work, n, dt, constants, friction, rolling, dashpots, gradient, turning)
        for i in range(len(block) // 2, len(block), LANES):
            prefetch(block, len(block) + i)
        add_forces(forces, a, b, work, turning)


@compiled
def first_image(sites: np.ndarray, owner: np.ndarray) -> int:
    """Index of the first image among the sites: whole blocks of grains precede the images."""
    return len(sites) - 1 - len(owner)


@compiled
def write_sites(sites: np.ndarray, block: np.ndarray, start: int, n: int) -> None:
    """Write the sites of the n grains of a block."""
    for i in range(0, n, LANES):
        put(sites, SITE_X, start + i, block, X + i)
        put(sites, SITE_V, start + i, block, V + i)
        put(sites, SITE_W, start + i, block, W + i)


@kept
def domain_grains(
    sites: np.ndarray,
    forces: np.ndarray,
    grains: np.ndarray,
    work: np.ndarray,
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
            take(forces, SITE_FORCE, start + i, work, GRAIN_FORCE + i)
            take(forces, SITE_TORQUE, start + i, work, GRAIN_FORCE + 3 * WIDTH + i)
        move_block(block, work, n, dt, L, before, damping, energy)
        write_sites(sites, block, start, n)


@kept
def collect_images(forces: np.ndarray, owner: np.ndarray, first: int, last: int) -> None:
    """Add the forces on the images first <= k < last to the grains `owner`, and reset them."""
    images = first_image(forces, owner)
    for image in range(first, last):
        row, copy = forces[owner[uint(image)]], forces[uint(images + image)]
        for k in range(FORCE_COLUMNS):
            row[k] += copy[k]
            copy[k] = 0.0


@kept
def image_sites(
    sites: np.ndarray,
    owner: np.ndarray,
    first: int,
    last: int,
    shift: np.ndarray,
    offset: np.ndarray,
    drift: np.ndarray,
) -> None:
    """Write the sites of the images first <= k < last, `shift` (image, 3) periods away from the grains `owner`.

    offset and drift (3, 3): the position and velocity that a period adds, which are the cell and L times the cell
    before the motion.
    """
    images = first_image(sites, owner)
    for image in range(first, last):
        row, copy, periods = sites[owner[uint(image)]], sites[uint(images + image)], shift[uint(image)]
        x, y, z = periods[0], periods[1], periods[2]
        for k in range(3):
            copy[SITE_X + k] = row[SITE_X + k] + (offset[k, 0] * x + offset[k, 1] * y + offset[k, 2] * z)
            copy[SITE_V + k] = row[SITE_V + k] + (drift[k, 0] * x + drift[k, 1] * y + drift[k, 2] * z)
            copy[SITE_W + k] = row[SITE_W + k]


@compiled
def farthest(grains: np.ndarray, start: np.ndarray, number: int, back: np.ndarray) -> float:
    """Largest distance of a grain from its position `start` (grain, 3) at the last search, in the cell at that time, m.

    back (3, 3): inverse of the deformation gradient of the cell since the search.
    """
    largest = 0.0
    for g in range(number):
        block, i = grains[g // WIDTH], g % WIDTH
        squared = 0.0
        for k in range(3):
            moved = back[k, 0] * block[i] + back[k, 1] * block[WIDTH + i] + back[k, 2] * block[2 * WIDTH + i]
            squared += (moved - start[g, k]) ** 2
        largest = max(largest, squared)
    return math.sqrt(largest)


@kept
def drift_of(cell: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Velocity that a period adds (3, 3), L times the cell before the motion, m/s."""
    return L @ cell


@kept
def search_is_due(
    motion: Motion, L: np.ndarray, dt: float, speed: np.ndarray, grains: np.ndarray, start: np.ndarray
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
        spread[0] = farthest(grains, start, len(start), back)
        return 2.0 * spread[0] > 0.9 * left
    return False


def advance(
    steps: int,
    moved_already: bool,
    dt: float,
    L: np.ndarray,
    motion: Motion,
    arrays: Arrays,
    constants: tuple[float, ...],
    friction: Any,
    rolling: Any,
    dashpots: Any,
    damping: float | None,
    gradient: np.ndarray | None,
    turning: bool | None,
) -> tuple[int, bool]:
    """Run up to `steps` steps of dt, s; return the number completed, and True if a neighbour search is needed.

    If a search is needed, the grains have already been moved for the next step, but its forces have not been computed:
    run the search, then call again with moved_already. L (3, 3): velocity gradient, 1/s; gradient: L if energies are
    summed, else None. The other arguments from `constants` to `turning` are fields of labkit.dem.laws.Features. Numba
    compiles the loop without the features that are None. It can do so only for function arguments, so they are not
    packed in a tuple.
    """
    grain_first, contact_first, contact_last = arrays.grain_first, arrays.contact_first, arrays.contact_last
    sites, forces, grains, work = arrays.sites, arrays.forces, arrays.grains, arrays.work
    image_first, owner, shift = arrays.image_first, arrays.owner, arrays.shift
    pairs, blocks, start = arrays.pairs, arrays.blocks, arrays.start
    cell, before = motion.cell, motion.before
    domains = len(contact_first)
    speed = np.empty(domains)
    for step in range(steps):
        if not (moved_already and step == 0):
            drift = drift_of(cell, L)
            move_cell(cell, L, dt)
            for d in numba.prange(domains):
                collect_images(forces, owner, image_first[d], image_first[d + 1])
                domain_grains(
                    sites, forces, grains, work[d], grain_first[d], grain_first[d + 1], dt, L, before, damping, gradient
                )
                image_sites(sites, owner, image_first[d], image_first[d + 1], shift, cell, drift)
                speed[d] = largest_speed(work[d])
            if search_is_due(motion, L, dt, speed, grains, start):
                return step, True
        for d in numba.prange(domains):
            domain_contacts(
                sites,
                forces,
                pairs,
                blocks,
                work[d],
                contact_first[d],
                contact_last[d],
                dt,
                constants,
                friction,
                rolling,
                dashpots,
                gradient,
                turning,
            )
    return steps, False


def branch_force(arrays: Arrays, friction: Any) -> np.ndarray:
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
            read_sites(arrays.sites, arrays.pairs[0, start:end], arrays.pairs[1, start:end], work, None)
            block_stress(arrays.blocks[start // WIDTH], work, n, friction, sums)
    total = np.zeros((3, 3))
    for k in range(9):
        for i in range(WIDTH):
            total[k // 3, k % 3] += sums[k * WIDTH + i]
    return total
