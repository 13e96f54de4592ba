"""The loop over steps. Grains and contacts are divided into domains that do not depend on the number of threads, and
every sum has one order: any number of threads gives the same bits.

A domain holds a run of grains in spatial order and the contacts of which they are the first grain. The second grain
may belong to another domain or be a periodic image: then the contact holds an image, a site of its own, filled from
the grain after each motion. So a contact knows no periods, and domains share no site that they write to.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy import uint64 as uint  # an index that cannot be negative: Numba then leaves out its check

from labkit.engines.kernel.lanes import add, add_opposite, prefetch, put, read, read_difference, take
from labkit.engines.kernel.law_paper import paper_block
from labkit.engines.kernel.law_yade import yade_block
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
    compiled,
    compiled_with,
)
from labkit.engines.kernel.motion import largest_speed, move_block, move_cell


@compiled
def whole_lanes(n):
    return (n + LANES - 1) // LANES * LANES


@compiled
def read_sites(sites, first, second, work, turning):
    """The rows D to WB of contacts from the sites of their grains; without velocities if `turning` is None."""
    for i in range(0, len(first), LANES):
        read_difference(sites, SITE_X, first, second, i, work, D + i)
        if turning is not None:
            read_difference(sites, SITE_V, first, second, i, work, VREL + i)
            read(sites, SITE_W, first, i, work, WA + i)
            read(sites, SITE_W, second, i, work, WB + i)


@compiled
def add_forces(forces, first, second, work, turning):
    """Adds forces and torques of contacts to their sites."""
    for i in range(0, len(first), LANES):
        add_opposite(forces, SITE_FORCE, first, second, i, work, FORCE + i)
        if turning is not None:
            add(forces, SITE_TORQUE, first, i, work, TORQUE_A + i)
            add(forces, SITE_TORQUE, second, i, work, TORQUE_B + i)


@compiled
def domain_contacts(sites, forces, pairs, blocks, work, first, last, dt, kt_over_kn, friction, rolling, yade,
                    paper, dashpots, gradient, turning):  # fmt: skip
    """All contacts first <= k < last of a domain, a whole number of blocks before them.

    yade, paper: None for the other law.
    """
    for start in range(first, last, WIDTH):
        n = whole_lanes(min(WIDTH, last - start))
        block = blocks[start // WIDTH]
        for i in range(0, len(block) // 2, LANES):
            prefetch(block, len(block) + i)  # of the next block: in two halves, not to queue up
        a, b = pairs[0, start : start + n], pairs[1, start : start + n]
        read_sites(sites, a, b, work, turning)
        if yade is not None:
            yade_block(block, work, n, dt, kt_over_kn, friction, rolling, gradient)
        if paper is not None:
            paper_block(block, work, n, dt, kt_over_kn, friction, rolling, dashpots, gradient)
        for i in range(len(block) // 2, len(block), LANES):
            prefetch(block, len(block) + i)
        add_forces(forces, a, b, work, turning)


@compiled
def first_image(sites, owner):
    """Number of the first site that is an image: before them are whole blocks of grains, after them nobody's site."""
    return len(sites) - 1 - len(owner)


@compiled
def write_sites(sites, block, start, n):
    """The sites of the n grains of a block."""
    for i in range(0, n, LANES):
        put(sites, SITE_X, start + i, block, X + i)
        put(sites, SITE_V, start + i, block, V + i)
        put(sites, SITE_W, start + i, block, W + i)


@compiled
def domain_grains(sites, forces, grains, work, first, last, dt, L, before, damping, energy):
    """Moves the grains first <= g < last and their sites."""
    for start in range(first, last, WIDTH):
        n = min(WIDTH, last - start)
        block = grains[start // WIDTH]
        for i in range(0, n, LANES):
            take(forces, SITE_FORCE, start + i, work, GRAIN_FORCE + i)
            take(forces, SITE_TORQUE, start + i, work, GRAIN_FORCE + 3 * WIDTH + i)
        move_block(block, work, n, dt, L, before, damping, energy)
        write_sites(sites, block, start, n)


@compiled
def collect_images(forces, owner, first, last):
    """Moves the forces of the images first <= k < last to the grains `owner`."""
    images = first_image(forces, owner)
    for image in range(first, last):
        row, copy = forces[owner[uint(image)]], forces[uint(images + image)]
        for k in range(FORCE_COLUMNS):
            row[k] += copy[k]
            copy[k] = 0.0


@compiled
def image_sites(sites, owner, first, last, shift, offset, drift):
    """Writes the sites of the images first <= k < last of the grains `owner`, `shift` (image, 3) periods away.

    offset and drift (3, 3): the cell, and L times the cell before the motion: what a period adds to position and
    velocity.
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
def farthest(grains, start, number, back):
    """Largest distance of a grain from its place `start` (grain, 3) at the last search, in the cell of then.

    back (3, 3): F^-1, F the deformation of the cell since.
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


def _make_advance(parallel):
    """The loop over steps; compiled once for one thread and once for several."""

    def advance(steps, moved_already, dt, L, before, cell, grain_first, contact_first, contact_last, sites, forces,
                grains, image_first, owner, shift, pairs, blocks, work, start, first_cell, spread, limits,
                kt_over_kn, friction, rolling, yade, paper, dashpots, damping, gradient, turning):  # fmt: skip
        """Takes up to `steps` steps; returns how many were taken, and whether neighbours must be sought.

        In that case the last motion has been made, its forces not: search, and go on with moved_already.
        spread (2,): how far grains may have moved since the search, at most, and how much the cell has stretched.
        """
        domains = len(contact_first)
        cell_before = np.empty((3, 3))
        speed = np.empty(domains)
        largest_diameter, margin = limits
        for step in range(steps):
            if not (moved_already and step == 0):
                cell_before[:] = cell
                move_cell(cell, L, dt)
                drift = L @ cell_before
                for d in numba.prange(domains):
                    collect_images(forces, owner, image_first[d], image_first[d + 1])
                    domain_grains(sites, forces, grains, work[d], grain_first[d], grain_first[d + 1], dt, L, before,
                                  damping, gradient)  # fmt: skip
                    image_sites(sites, owner, image_first[d], image_first[d + 1], shift, cell, drift)
                    speed[d] = largest_speed(work[d])
                before[:] = L
                spread[1] /= 1.0 - dt * math.sqrt((L * L).sum())
                spread[0] += dt * speed.max() * spread[1]
                left = margin - largest_diameter * (spread[1] - 1.0)
                if 2.0 * spread[0] > left:
                    back = first_cell @ np.linalg.inv(cell)
                    spread[0] = farthest(grains, start, len(start), back)
                    if 2.0 * spread[0] > 0.9 * left:
                        return step, True
            for d in numba.prange(domains):
                domain_contacts(sites, forces, pairs, blocks, work[d], contact_first[d], contact_last[d], dt,
                                kt_over_kn, friction, rolling, yade, paper, dashpots, gradient, turning)  # fmt: skip
        return steps, False

    advance.__qualname__ = f"advance_parallel_{parallel}"  # Numba's cache tells functions apart by their names
    return compiled_with(parallel=parallel)(advance)


advance_one_thread = _make_advance(False)
advance_threads = _make_advance(True)
