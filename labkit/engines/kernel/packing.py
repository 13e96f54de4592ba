"""Converts the grains and contacts of a State to the kernel's blocks, sites and domains, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from labkit.engines.kernel.layout import (
    FORCE_COLUMNS,
    GRAIN_ROWS,
    HISTORY,
    SITE_COLUMNS,
    WIDTH,
    WORK_ROWS,
)
from labkit.engines.kernel.neighbours import LOST, find_pairs, sort_grains
from labkit.engines.kernel.steps import Arrays

GRAINS_PER_DOMAIN, MOST_DOMAINS = 3000, 16
LINE = 64  # bytes per cache line
NEAR = 3  # largest periodic shift between two neighbouring grains that are wrapped into the cell


@dataclasses.dataclass(frozen=True)
class Grains:
    """Grains in the order of the State: position, velocity, spin (grain, 3); radius, mass, inertia (grain,)."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray


@dataclasses.dataclass(frozen=True)
class History:
    """Contact history of pairs of grains, in which the first index is not greater than the second.

    grain (n, 2): indices; shift (n, 3): periodic shift of the second grain; rows (n, 0, 3 or 6): tangential force and
    rolling moment on the first grain, where present in the scene.
    """

    grain: np.ndarray
    shift: np.ndarray
    rows: np.ndarray


@dataclasses.dataclass(frozen=True)
class Packing:
    """The arrays of labkit.engines.kernel.steps, and the data needed to unpack them.

    order (grain,): index in the State of each grain; slot (n,): position of each pair in the blocks; pair (n, 2):
    indices of its grains in the order of the grid; pair_shift (n, 3): periodic shift of its second grain.
    """

    arrays: Arrays
    order: np.ndarray
    slot: np.ndarray
    pair: np.ndarray
    pair_shift: np.ndarray

    def unpack_grains(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position, velocity and spin, each (grain, 3), in the order of the State."""
        back = np.empty_like(self.order)
        back[self.order] = np.arange(len(back))
        rows = from_blocks(self.arrays.grains, len(back))[:9, back]
        position, velocity, spin = (np.ascontiguousarray(rows[k : k + 3].T) for k in (0, 3, 6))
        return position, velocity, spin

    def unpack_history(self) -> History:
        """Return the History of all pairs, touching or not."""
        blocks = self.arrays.blocks.reshape(len(self.arrays.blocks), -1, WIDTH)
        rows = blocks[self.slot // WIDTH, HISTORY // WIDTH :, self.slot % WIDTH]  # a copy
        return ordered(self.order[self.pair], self.pair_shift, rows)


def ordered(grain: np.ndarray, shift: np.ndarray, rows: np.ndarray) -> History:
    """Build a History with the smaller index first.

    For contacts between a grain and its own image the sign of the shift is made unique.
    grain (n, 2), shift (n, 3), rows (n, k): as in History; rows are changed in place.
    """
    first, second = grain[:, 0], grain[:, 1]
    leading = np.sign(shift) @ np.array([9, 3, 1])
    swap = ((first > second) | ((first == second) & (leading < 0)))[:, None]
    sign = np.where(swap, -1, 1)
    rows *= sign
    return History(np.where(swap, grain[:, ::-1], grain), shift * sign, rows)


def pack(
    grains: Grains,
    history: History,
    cell: np.ndarray,
    margin: float,
    stiffness: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> Packing:
    """Find all pairs closer than `margin`, m, and lay out all arrays; sites and images are left empty.

    cell (3, 3), m; stiffness(radius_a, radius_b): kn, N/m. Raises PhysicsError if a grain is lost.
    """
    number = len(grains.radius)
    grid = sort_grains(grains.position, cell, 2.0 * grains.radius.max() + margin)
    order, radius = grid.order, grains.radius[grid.order]
    position = grains.position[order]
    pairs, shift = find_pairs(position, radius, cell, grid, margin)
    domains = int(np.clip(number // GRAINS_PER_DOMAIN, 1, MOST_DOMAINS))
    grain_first = np.minimum(-(-number // (domains * WIDTH)) * WIDTH * np.arange(domains + 1), number)

    first_pair = np.searchsorted(pairs[0], grain_first)
    counts = np.diff(first_pair)
    room = -(-counts // WIDTH) * WIDTH
    contact_first = np.concatenate([[0], np.cumsum(room)[:-1]])
    domain = np.repeat(np.arange(domains), counts)
    slot = np.arange(len(shift)) + (contact_first - first_pair[:-1])[domain]
    blocks = len(slot) and int(room.sum()) // WIDTH

    first_image = -(-number // WIDTH) * WIDTH
    second, owner, image_shift = make_images(pairs, shift, domain, grain_first, first_image)
    unused = first_image + len(owner)
    placed = np.full((2, max(blocks, 1) * WIDTH), unused, np.uint32)
    placed[0, slot], placed[1, slot] = pairs[0], second
    a, b = radius[pairs[0]], radius[pairs[1]]
    # the unused site pads each block with contacts with itself, which have neither normal nor history and so no force
    laid = aligned((max(blocks, 1), HISTORY // WIDTH + history.rows.shape[1], WIDTH))
    laid[:, : HISTORY // WIDTH] = 1.0
    for row, numbers in enumerate((stiffness(a, b), a, b)):
        laid[slot // WIDTH, row, slot % WIDTH] = numbers
    for row, numbers in enumerate(carried(history, order, pairs, shift, grid.period).T, HISTORY // WIDTH):
        laid[slot // WIDTH, row, slot % WIDTH] = numbers
    values = (grains.position, grains.velocity, grains.spin)
    columns = np.concatenate([*(v[order].T for v in values), [1.0 / grains.mass[order], 1.0 / grains.inertia[order]]])
    arrays = Arrays(
        grain_first=grain_first,
        contact_first=contact_first,
        contact_last=contact_first + counts,
        sites=aligned((unused + 1, SITE_COLUMNS)),
        forces=aligned((unused + 1, FORCE_COLUMNS)),
        grains=to_blocks(columns, GRAIN_ROWS),
        image_first=np.searchsorted(owner, grain_first),
        owner=owner,
        shift=image_shift,
        pairs=placed,
        blocks=laid.reshape(len(laid), -1),
        work=aligned((domains, WORK_ROWS * WIDTH)),
        start=position,
    )
    return Packing(arrays, order, slot, pairs.T, shift)


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of zeros that is aligned to a cache line."""
    count = int(np.prod(shape))
    memory = np.zeros(count + LINE // 8)
    first = -memory.ctypes.data % LINE // 8
    return memory[first : first + count].reshape(shape)


def make_images(
    pairs: np.ndarray, shift: np.ndarray, domain: np.ndarray, grain_first: np.ndarray, first_image: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the site of the second grain of each pair (n,), and owner (image,) and shift (image, 3) of the images.

    The second grain of a pair gets an image, a separate site numbered from `first_image`, if it lies in another period
    or belongs to another domain.
    """
    second = pairs[1].copy()
    needed = np.flatnonzero(shift.any(axis=1) | (np.searchsorted(grain_first, second, side="right") - 1 != domain))
    key = second[needed].astype(np.int64) * MOST_DOMAINS + domain[needed]
    for k in range(3):
        key = key * (4 * LOST) + (shift[needed, k] + 2 * LOST)
    _, index, inverse = np.unique(key, return_index=True, return_inverse=True)
    second[needed] = first_image + inverse
    return second, pairs[1][needed][index], shift[needed][index].astype(float)


def wrapped(shift: np.ndarray, first: np.ndarray, second: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Encode the periodic shift between the grains of each pair, both wrapped into the cell, as one integer, (n,)."""
    steps = shift + period[second] - period[first] + NEAR
    size = 2 * NEAR + 1
    near = ((steps >= 0) & (steps < size)).all(axis=1)
    return np.where(near, (steps[:, 0] * size + steps[:, 1]) * size + steps[:, 2], 0)


def carried(
    history: History, order: np.ndarray, pairs: np.ndarray, shift: np.ndarray, period: np.ndarray
) -> np.ndarray:
    """Return the history of each new pair (2, n), as (n, k): rows of the same pair in the History, else zero."""
    number, columns = len(order), history.rows.shape[1]
    result = np.zeros((len(shift), columns))
    if len(history.grain) == 0 or len(shift) == 0 or columns == 0:
        return result
    by_number = np.empty_like(period)
    by_number[order] = period
    new = ordered(order[pairs.T], shift, np.ones((len(shift), 1)))

    def key(pairs: History) -> np.ndarray:
        first, second = pairs.grain[:, 0], pairs.grain[:, 1]
        near = wrapped(pairs.shift, first, second, by_number)
        return (first.astype(np.int64) * number + second) * (2 * NEAR + 1) ** 3 + near

    old_key, new_key = key(history), key(new)
    by = np.argsort(old_key)
    at = by[np.minimum(np.searchsorted(old_key, new_key, sorter=by), len(by) - 1)]
    same = old_key[at] == new_key
    result[same] = history.rows[at[same]] * new.rows[same]
    return result


def to_blocks(rows: np.ndarray, number: int) -> np.ndarray:
    """Convert rows (k, n) to blocks (n/WIDTH, number WIDTH); missing rows and the end of the last block are ones."""
    blocks = -(-rows.shape[1] // WIDTH)
    filled = np.ones((number, blocks * WIDTH))
    filled[:, : rows.shape[1]] = rows
    result = aligned((blocks, number, WIDTH))
    result[:] = filled.reshape(number, blocks, WIDTH).transpose(1, 0, 2)
    return result.reshape(blocks, -1)


def from_blocks(blocks: np.ndarray, count: int) -> np.ndarray:
    """Convert blocks back to rows (number, count); the inverse of to_blocks."""
    rows = blocks.reshape(len(blocks), -1, WIDTH).transpose(1, 0, 2)
    return rows.reshape(rows.shape[0], -1)[:, :count]
