"""Arranges grains and pairs after a neighbour search: sorts them, finds images, and carries over contact history."""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.kernel.compiling import compile_and_keep, compile_callee
from labkit.engines.kernel.layout import WIDTH

LOST = 1000  # periods: a grain farther away is considered lost
DIGIT = 16 * LOST  # more than twice the largest periodic shift of a pair


@compile_and_keep
def by_number(numbers: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort integers (n,) from 0 to most - 1 by counting; equal integers keep their order.

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


def find_images(
    pairs: np.ndarray, shift: np.ndarray, grain_first: np.ndarray, first_image: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the site of the second grain of each pair (n,), and owner (image,) and shift (image, 3) of the images.

    The second grain of a pair gets an image, a separate site numbered from `first_image`, if it lies in another period
    or domain than the first grain. Images are sorted by owner, domain and shift.

    Args:
        pairs: Grains of each pair, (2, n), sorted by the first.
        shift: Periodic shift of the second grain, (n, 3).
        grain_first: First grain of each domain, (domain + 1,).
        first_image: Number of the first image.
    """
    domain, own = DIGIT**3 * (pairs // grain_first[1])
    key = domain + shift @ DIGIT ** np.array([2, 1, 0])  # one number for domain and shift
    needed = np.flatnonzero(key != own)
    needed = needed.take(np.lexsort((key.take(needed), pairs[1].take(needed))))
    site, key = pairs[1].astype(np.int64), key.take(needed)
    owner = site.take(needed)
    differs = np.ones(len(needed), bool)
    differs[1:] = (owner[1:] != owner[:-1]) | (key[1:] != key[:-1])
    site[needed] = first_image + np.cumsum(differs) - 1
    return site, owner[differs], shift.take(needed[differs], 0).astype(float)


@compile_callee
def reversal(first: int, second: int, x: int, y: int, z: int) -> int:
    """Return -1 if a pair must be reversed so that its smaller index comes first, else 1.

    The periodic shift x, y, z of the second grain decides for a grain and its own image.
    """
    if first != second:
        return -1 if first > second else 1
    return -1 if 9 * np.sign(x) + 3 * np.sign(y) + np.sign(z) < 0 else 1


@compile_and_keep
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
    """Write stiffness and history of new pairs into blocks; pairs without history get zeros.

    Contacts that fill up a block get the stiffness one.

    Args:
        pairs: Pairs of the History, (2, m).
        shift: Periodic shifts of the History, (m, 3).
        rows: Rows of the History, (m, k).
        number: Index in the History of each grain of the new pairs, (grain,).
        new_pairs: Grains of the new pairs, (2, n).
        new_shift: Periodic shifts of the new pairs, (n, 3).
        slot: Positions of the new pairs in the blocks, (n,).
        stiffness: kn of the new pairs, (n,), N/m.
        blocks: Blocks to write to, (block, row, WIDTH).
    """
    blocks[:, 0] = 1.0
    columns, many = rows.shape[1], pairs.shape[1]
    start, entries = by_number(np.minimum(pairs[0], pairs[1]), len(number))
    next_one = 0  # the order of the pairs hardly changes from one search to the next: try this pair first
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


@compile_and_keep
def take_rows(blocks: np.ndarray, first: int, slot: np.ndarray) -> np.ndarray:
    """Return the values (n, k) at the places slot (n,) of the k rows of blocks (block, ...) from offset `first` on."""
    rows = np.empty((len(slot), (blocks.shape[1] - first) // WIDTH), blocks.dtype)
    for k in range(len(slot)):
        block, i = slot[k] // WIDTH, slot[k] % WIDTH
        for j in range(rows.shape[1]):
            rows[k, j] = blocks[block, first + j * WIDTH + i]
    return rows


@compile_and_keep
def touching(
    pair: np.ndarray, shift: np.ndarray, position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> np.ndarray:
    """Return the indices of the pairs of grains that overlap or touch.

    Args:
        pair: Grains of each pair, (n, 2).
        shift: Periods of the second grain, (n, 3).
        position: (grain, 3), m.
        radius: (grain,), m.
        cell: (3, 3), m.
    """
    found, count = np.empty(len(pair), np.int64), 0
    for k in range(len(pair)):
        a, b, squared = pair[k, 0], pair[k, 1], 0.0
        for j in range(3):
            period = cell[j, 0] * shift[k, 0] + cell[j, 1] * shift[k, 1] + cell[j, 2] * shift[k, 2]
            d = position[b, j] + period - position[a, j]
            squared += d * d
        if radius[a] + radius[b] - math.sqrt(squared) >= 0.0:
            found[count] = k
            count += 1
    return found[:count]
