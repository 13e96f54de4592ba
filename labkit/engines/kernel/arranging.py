"""Compiled loops of a neighbour search: images, contact history and blocks; and the contacts of a State.

Their time is proportional to the number of grains and pairs.
"""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.kernel.compiling import compiled, kept
from labkit.engines.kernel.layout import (
    INVERSE_INERTIA,
    INVERSE_MASS,
    PLACE_RADIUS,
    SITE_RADIUS,
    SITE_V,
    SITE_W,
    WIDTH,
    V,
)

LOST = 1000  # periods: a grain farther away is considered lost


@kept
def by_number(numbers: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort integers (n,) from 0 to most - 1 by counting; equal ones keep their order.

    Returns `start` (most + 1,) and `order` (n,): order[start[k]] to order[start[k + 1] - 1] are the entries equal to k.
    """
    start = np.zeros(most + 1, np.int64)
    for number in numbers:
        start[number + 1] += 1
    for k in range(most):
        start[k + 1] += start[k]
    free = start.copy()
    order = np.empty(len(numbers), np.int64)
    for entry in range(len(numbers)):
        order[free[numbers[entry]]] = entry
        free[numbers[entry]] += 1
    return start, order


@kept
def find_images(
    pairs: np.ndarray, shift: np.ndarray, grain_first: np.ndarray, first_image: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the site of the second grain of each pair (n,), and owner (image,) and shift (image, 3) of the images.

    pairs (2, n), shift (n, 3): grains of each pair, sorted by the first, and the periodic shift of the second.
    grain_first (domain + 1,): first grain of each domain. The second grain of a pair gets an image, a separate site
    numbered from `first_image`, if it lies in another period or in another domain than the first grain. Images are
    sorted by owner, domain and shift.
    """
    grains = grain_first[-1]
    site = pairs[1].copy()
    needed, key = np.empty(len(site), np.int64), np.empty(len(site), np.int64)
    count = domain = 0
    for k in range(len(site)):
        while pairs[0, k] >= grain_first[domain + 1]:
            domain += 1
        x, y, z = shift[k, 0], shift[k, 1], shift[k, 2]
        inside = grain_first[domain] <= site[k] < grain_first[domain + 1]
        if not (inside and x == 0 and y == 0 and z == 0):
            needed[count] = k
            key[count] = ((domain * 4 * LOST + (x + 2 * LOST)) * 4 * LOST + (y + 2 * LOST)) * 4 * LOST + (z + 2 * LOST)
            count += 1
    needed = needed[:count]
    start, order = by_number(pairs[1][needed], grains)
    keys, first_with = np.empty(count, np.int64), np.empty(count, np.int64)
    images = 0
    for owner in range(grains):
        first = images
        members = order[start[owner] : start[owner + 1]]
        for j in members:  # sorts the different images of this grain
            place = images
            while place > first and keys[place - 1] > key[j]:
                place -= 1
            if place > first and keys[place - 1] == key[j]:
                continue
            for later in range(images, place, -1):
                keys[later], first_with[later] = keys[later - 1], first_with[later - 1]
            keys[place], first_with[place] = key[j], needed[j]
            images += 1
        for j in members:
            image = first
            while keys[image] != key[j]:
                image += 1
            site[needed[j]] = first_image + image
    first_with = first_with[:images]
    return site, pairs[1][first_with].astype(np.int64), shift[first_with].astype(np.float64)


@compiled
def reversal(first: int, second: int, x: int, y: int, z: int) -> int:
    """Return -1 if a pair must be reversed so that its smaller index comes first, else 1.

    x, y, z: periodic shift of the second grain; it decides for a grain and its own image.
    """
    if first != second:
        return -1 if first > second else 1
    return -1 if 9 * np.sign(x) + 3 * np.sign(y) + np.sign(z) < 0 else 1


@kept
def carry(
    pairs: np.ndarray,
    shift: np.ndarray,
    rows: np.ndarray,
    number: np.ndarray,
    new_pairs: np.ndarray,
    new_shift: np.ndarray,
    slot: np.ndarray,
    stiffness: np.ndarray,
    blocks: np.ndarray,
) -> None:
    """Write new pairs into blocks (block, row, WIDTH): stiffness and history, zero for pairs that have none.

    pairs (2, m), shift (m, 3), rows (m, k): the History; number (grain,): index in it of each grain of the new pairs
    (2, n); new_shift (n, 3), slot, stiffness (n,): shifts of these, positions in the blocks, kn. Contacts that fill up
    a block get the stiffness one.
    """
    blocks[:, 0] = 1.0
    columns, many = rows.shape[1], pairs.shape[1]
    start, entries = by_number(np.minimum(pairs[0], pairs[1]), len(number))
    next_one = 0  # the order of the pairs hardly changes from one search to the next: try this one first
    for new in range(len(slot)):
        block, i = slot[new] // WIDTH, slot[new] % WIDTH
        first, second = number[new_pairs[0, new]], number[new_pairs[1, new]]
        x, y, z = new_shift[new, 0], new_shift[new, 1], new_shift[new, 2]
        blocks[block, 0, i] = stiffness[new]
        found, sign = -1, 1
        if next_one < many and pairs[0, next_one] == first and pairs[1, next_one] == second:
            s = shift[next_one]
            if s[0] == x and s[1] == y and s[2] == z:
                found = next_one
        if found < 0:
            turn = reversal(first, second, x, y, z)
            for old in entries[start[min(first, second)] : start[min(first, second) + 1]]:
                if pairs[0, old] + pairs[1, old] == first + second:
                    s = shift[old]
                    sign = turn * reversal(pairs[0, old], pairs[1, old], s[0], s[1], s[2])
                    if s[0] == sign * x and s[1] == sign * y and s[2] == sign * z:
                        found = old
                        break
        for k in range(columns):
            blocks[block, 1 + k, i] = sign * rows[found, k] if found >= 0 else 0.0
        if found >= 0:
            next_one = found + 1


@kept
def take_history(blocks: np.ndarray, slot: np.ndarray) -> np.ndarray:
    """Return the history (n, k) of the contacts in the positions slot (n,) of blocks (block, row, WIDTH)."""
    rows = np.empty((len(slot), blocks.shape[1] - 1), blocks.dtype)
    for k in range(len(slot)):
        block, i = slot[k] // WIDTH, slot[k] % WIDTH
        for j in range(rows.shape[1]):
            rows[k, j] = blocks[block, 1 + j, i]
    return rows


@kept
def put_grains(
    places: np.ndarray,
    motions: np.ndarray,
    blocks: np.ndarray,
    masses: np.ndarray,
    order: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
    radius: np.ndarray,
    inverse_mass: np.ndarray,
    inverse_inertia: np.ndarray,
) -> None:
    """Write grains into their sites and blocks; they are in the order of the State, `order` is as in a Packing."""
    for k in range(len(order)):
        block, of_masses, i, g = blocks[k // WIDTH], masses[k // WIDTH], k % WIDTH, order[k]
        for j in range(3):
            places[k, j] = position[g, j]
            block[V + j * WIDTH + i] = velocity[g, j]
            motions[k, SITE_V + j], motions[k, SITE_W + j] = velocity[g, j], spin[g, j]
        places[k, PLACE_RADIUS] = motions[k, SITE_RADIUS] = radius[g]
        of_masses[INVERSE_MASS + i], of_masses[INVERSE_INERTIA + i] = inverse_mass[g], inverse_inertia[g]


@kept
def take_grains(
    places: np.ndarray,
    motions: np.ndarray,
    blocks: np.ndarray,
    order: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
) -> None:
    """Write position, velocity and spin (grain, 3) of the grains, the inverse of put_grains."""
    for k in range(len(order)):
        block, i, g = blocks[k // WIDTH], k % WIDTH, order[k]
        for j in range(3):
            position[g, j], spin[g, j] = places[k, j], motions[k, SITE_W + j]
            velocity[g, j] = block[V + j * WIDTH + i]


@kept
def touching(
    pairs: np.ndarray, shift: np.ndarray, number: np.ndarray, position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of a History whose grains overlap or touch, as in a State.

    pairs (2, m), shift (m, 3): those of the History; number (grain,): index in it of each grain of the State, to which
    position (grain, 3) and radius (grain,) refer; cell (3, 3). Returns the rows of the History (n,), the sign of each
    (n,), -1 if its two grains are exchanged, and contact_grain (n, 2) and contact_shift (n, 3) of the State, sorted by
    first grain, second grain and shift.
    """
    here = np.empty(len(number), np.int64)
    for g in range(len(number)):
        here[number[g]] = g
    row, sign = np.empty(pairs.shape[1], np.int64), np.empty(pairs.shape[1], np.int64)
    grain, shifts = np.empty((pairs.shape[1], 2), np.int32), np.empty((pairs.shape[1], 3), np.int32)
    count = 0
    for k in range(pairs.shape[1]):
        a, b = here[pairs[0, k]], here[pairs[1, k]]
        x, y, z = shift[k, 0], shift[k, 1], shift[k, 2]
        turn = reversal(a, b, x, y, z)
        if turn < 0:
            a, b, x, y, z = b, a, -x, -y, -z
        squared = 0.0
        for j in range(3):
            d = position[b, j] + (cell[j, 0] * x + cell[j, 1] * y + cell[j, 2] * z) - position[a, j]
            squared += d * d
        if radius[a] + radius[b] - math.sqrt(squared) >= 0.0:
            row[count], sign[count] = k, turn
            grain[count, 0], grain[count, 1] = a, b
            shifts[count, 0], shifts[count, 1], shifts[count, 2] = x, y, z
            count += 1
    start, order = by_number(grain[:count, 0], len(number))
    for a in range(len(number)):
        for k in range(start[a] + 1, start[a + 1]):
            moved, place = order[k], k
            while place > start[a] and is_before(grain, shifts, moved, order[place - 1]):
                order[place] = order[place - 1]
                place -= 1
            order[place] = moved
    return row[order], sign[order], grain[order], shifts[order]


@compiled
def is_before(grain: np.ndarray, shift: np.ndarray, one: int, other: int) -> bool:
    """True if a pair comes before another pair of the same first grain: by second grain, then by shift in z, y, x."""
    if grain[one, 1] != grain[other, 1]:
        return grain[one, 1] < grain[other, 1]
    for j in range(2, -1, -1):
        if shift[one, j] != shift[other, j]:
            return shift[one, j] < shift[other, j]
    return False
