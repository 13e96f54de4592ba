"""Converts the grains and contacts of a State to the kernel's blocks, sites and domains, and back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from labkit.engines.kernel.arranging import carry, find_images, put_grains, take_grains, take_history
from labkit.engines.kernel.layout import (
    DOUBLE_ROWS,
    FORCE_COLUMNS,
    GRAIN_ROWS,
    MASS_ROWS,
    PLACE_COLUMNS,
    PLACE_RADIUS,
    SITE_COLUMNS,
    SITE_RADIUS,
    WIDTH,
    WORK_ROWS,
)
from labkit.engines.kernel.neighbours import find_pairs, sort_grains
from labkit.engines.kernel.steps import Arrays

GRAINS_PER_DOMAIN, MOST_DOMAINS = 3000, 16
LINE = 64  # bytes per cache line


@dataclasses.dataclass(frozen=True)
class GrainArrays:
    """Grains in the order of the State: position, velocity, spin (grain, 3); radius, mass, inertia (grain,)."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray


@dataclasses.dataclass(frozen=True)
class History:
    """Contact history of pairs of grains.

    pairs (2, n): grains in any numbering; shift (n, 3): periodic shift of the second grain; rows (n, 0, 3 or 6):
    tangential force and rolling moment on the first grain, where present in the scene; number (grain,): index in this
    numbering of each grain of the State.
    """

    pairs: np.ndarray
    shift: np.ndarray
    rows: np.ndarray
    number: np.ndarray


@dataclasses.dataclass(frozen=True)
class PackedArrays:
    """The arrays of labkit.engines.kernel.steps, and the data needed to unpack them.

    order (grain,): index in the State of each grain; slot (n,): position of each pair in the blocks; pairs (2, n):
    indices of its grains in the order of the grid; pair_shift (n, 3): periodic shift of its second grain.
    """

    arrays: Arrays
    order: np.ndarray
    slot: np.ndarray
    pairs: np.ndarray
    pair_shift: np.ndarray

    def unpack_grains(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position, velocity and spin, each (grain, 3), in the order of the State."""
        position, velocity, spin = (np.empty((len(self.order), 3)) for _ in range(3))
        arrays = self.arrays
        take_grains(arrays.places, arrays.motions, arrays.grains, self.order, position, velocity, spin)
        return position, velocity, spin

    def unpack_history(self) -> History:
        """Return the History of all pairs, touching or not, with grains in the order of the grid."""
        blocks = self.arrays.blocks.reshape(len(self.arrays.blocks), -1, WIDTH)
        rows = take_history(blocks, self.slot)
        number = np.empty_like(self.order)
        number[self.order] = np.arange(len(number))
        return History(self.pairs, self.pair_shift, rows, number)


def pack(
    grains: GrainArrays,
    history: History,
    cell: np.ndarray,
    margin: float,
    stiffness: Callable[[np.ndarray, np.ndarray], np.ndarray],
    kind: type[np.floating],
) -> PackedArrays:
    """Find all pairs closer than `margin`, m, and lay out all arrays; images are left empty.

    cell (3, 3), m; stiffness(radius_a, radius_b): kn, N/m; kind: type of the numbers that may be single, np.float64 or
    np.float32. Raises PhysicsError if a grain is lost.
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
    slot = np.arange(len(shift)) + np.repeat(contact_first - first_pair[:-1], counts)
    blocks = max(1, int(room.sum()) // WIDTH)

    first_image = -(-number // WIDTH) * WIDTH
    second, owner, image_shift = find_images(pairs, shift, grain_first, first_image)
    unused = first_image + len(owner)
    placed = np.full((2, blocks * WIDTH), unused, np.uint32)
    placed[0, slot], placed[1, slot] = pairs[0], second
    laid = aligned((blocks, 1 + history.rows.shape[1], WIDTH), kind)
    old = history.pairs, history.shift, history.rows.astype(kind, copy=False), history.number[order]
    carry(*old, pairs, shift, slot, stiffness(radius[pairs[0]], radius[pairs[1]]), laid)
    grain_blocks = -(-number // WIDTH)
    velocities, masses = aligned((grain_blocks, GRAIN_ROWS * WIDTH)), aligned((grain_blocks, MASS_ROWS * WIDTH), kind)
    places, motions = aligned((unused + 1, PLACE_COLUMNS)), aligned((unused + 1, SITE_COLUMNS), kind)
    kinematics = grains.position, grains.velocity, grains.spin
    of_grains = *kinematics, grains.radius, 1.0 / grains.mass, 1.0 / grains.inertia
    put_grains(places, motions, velocities, masses, order, *of_grains)
    # the unused site pads each block with contacts with itself, which have neither normal nor history and so no force
    places[unused, PLACE_RADIUS] = motions[unused, SITE_RADIUS] = 1.0
    arrays = Arrays(
        grain_first=grain_first,
        contact_first=contact_first,
        contact_last=contact_first + counts,
        places=places,
        motions=motions,
        forces=aligned((unused + 1, FORCE_COLUMNS), kind),
        grains=velocities,
        masses=masses,
        image_first=np.searchsorted(owner, grain_first),
        owner=owner,
        shift=image_shift,
        pairs=placed,
        blocks=laid.reshape(blocks, -1),
        work=aligned((domains, WORK_ROWS * WIDTH), kind),
        doubles=aligned((domains, DOUBLE_ROWS * WIDTH)),
        start=position,
    )
    return PackedArrays(arrays, order, slot, pairs, shift)


def aligned(shape: tuple[int, ...], kind: type = float) -> np.ndarray:
    """Return an array of zeros that is aligned to a cache line."""
    memory = np.zeros(int(np.prod(shape)) * np.dtype(kind).itemsize + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    return memory[first : first + len(memory) - LINE].view(kind).reshape(shape)
