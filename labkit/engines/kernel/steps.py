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

from labkit.engines.kernel.law_paper import paper_block
from labkit.engines.kernel.law_yade import yade_block
from labkit.engines.kernel.layout import (
    FORCE,
    FORCE_COLUMNS,
    GRAIN_FORCE,
    SITE_COLUMNS,
    TORQUE_A,
    TORQUE_B,
    WIDTH,
    D,
    compiled,
    compiled_with,
)
from labkit.engines.kernel.motion import largest_speed, move_block, move_cell


@compiled
def read_sites(sites, first, second, work, turning):
    """The rows D to WB of contacts from the sites of their grains; without velocities if `turning` is None."""
    for i in range(len(first)):
        a, b = sites[first[uint(i)]], sites[second[uint(i)]]
        for k in range(3):
            work[uint(D + k * WIDTH + i)] = b[k] - a[k]
        if turning is not None:
            for k in range(3, 6):
                work[uint(D + k * WIDTH + i)] = b[k] - a[k]
            for k in range(6, 9):
                work[uint(D + k * WIDTH + i)] = a[k]
                work[uint(D + (k + 3) * WIDTH + i)] = b[k]


@compiled
def add_forces(forces, first, second, work, turning):
    """Adds forces and torques of contacts to their sites."""
    for i in range(len(first)):
        a, b = forces[first[uint(i)]], forces[second[uint(i)]]
        for k in range(3):
            a[k] += work[uint(FORCE + k * WIDTH + i)]
            b[k] -= work[uint(FORCE + k * WIDTH + i)]
        if turning is not None:
            for k in range(3):
                a[3 + k] += work[uint(TORQUE_A + k * WIDTH + i)]
                b[3 + k] += work[uint(TORQUE_B + k * WIDTH + i)]


@compiled
def domain_contacts(sites, forces, pairs, blocks, work, first, last, dt, kt_over_kn, friction, rolling, yade,
                    paper, dashpots, gradient, turning):  # fmt: skip
    """All contacts first <= k < last of a domain, a whole number of blocks before them.

    yade, paper: None for the other law.
    """
    for start in range(first, last, WIDTH):
        n = min(WIDTH, last - start)
        block = blocks[start // WIDTH]
        a, b = pairs[0, start : start + n], pairs[1, start : start + n]
        read_sites(sites, a, b, work, turning)
        if yade is not None:
            yade_block(block, work, n, dt, kt_over_kn, friction, rolling, gradient)
        if paper is not None:
            paper_block(block, work, n, dt, kt_over_kn, friction, rolling, dashpots, gradient)
        add_forces(forces, a, b, work, turning)


@compiled
def domain_grains(forces, grains, work, first, last, images, dt, L, before, damping, energy):
    """Moves the grains first <= g < last; their force is what they and their images have collected."""
    number = len(forces) - images[-1]
    for start in range(first, last, WIDTH):
        n = min(WIDTH, last - start)
        block = grains[start // WIDTH]
        rows, images_of = forces[start : start + n], images[start : start + n + 1]
        for i in range(n):
            row = rows[uint(i)]
            for image in range(number + images_of[uint(i)], number + images_of[uint(i + 1)]):
                for k in range(FORCE_COLUMNS):
                    row[k] += forces[uint(image), k]
                    forces[uint(image), k] = 0.0
            for k in range(FORCE_COLUMNS):
                work[uint(GRAIN_FORCE + k * WIDTH + i)] = row[k]
                row[k] = 0.0
        move_block(block, work, n, dt, L, before, damping, energy)


@compiled
def domain_sites(sites, grains, first, last, images, shift, offset, drift):
    """Writes the sites of the grains first <= g < last and of their images.

    images[g] to images[g + 1]: the images of a grain, which follow all grains in `sites`. offset and drift (3, 3):
    the cell, and L times the cell before the motion: what a period adds to position and velocity.
    """
    number = len(images) - 1
    for start in range(first, last, WIDTH):
        block, rows = grains[start // WIDTH], sites[start : min(start + WIDTH, last)]
        for i in range(len(rows)):
            for k in range(SITE_COLUMNS):
                rows[uint(i), k] = block[uint(k * WIDTH + i)]
    for g in range(first, last):
        for image in range(images[uint(g)], images[uint(g + 1)]):
            row, copy, periods = sites[uint(g)], sites[uint(number + image)], shift[uint(image)]
            x, y, z = periods[0], periods[1], periods[2]
            for k in range(3):
                copy[k] = row[k] + (offset[k, 0] * x + offset[k, 1] * y + offset[k, 2] * z)
                copy[3 + k] = row[3 + k] + (drift[k, 0] * x + drift[k, 1] * y + drift[k, 2] * z)
                copy[6 + k] = row[6 + k]


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
                grains, images, shift, pairs, blocks, work, start, first_cell, spread, limits, kt_over_kn, friction,
                rolling, yade, paper, dashpots, damping, gradient, turning):  # fmt: skip
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
                    first, last = grain_first[d], grain_first[d + 1]
                    domain_grains(forces, grains, work[d], first, last, images, dt, L, before, damping, gradient)
                    domain_sites(sites, grains, first, last, images, shift, cell, drift)
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
