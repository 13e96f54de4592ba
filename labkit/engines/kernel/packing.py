"""Converts the grains and contacts of a State to the kernel's blocks, sites and domains, and back."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from labkit.engines.kernel import host
from labkit.engines.kernel.layout import (
    DOUBLE_ROWS,
    FORCE_COLUMNS,
    GRAIN_ROWS,
    HISTORY,
    MASS_ROWS,
    PLACE_COLUMNS,
    PLACE_RADIUS,
    SITE_COLUMNS,
    SITE_RADIUS,
    SITE_V,
    SITE_W,
    WIDTH,
    WORK_ROWS,
    Arrays,
    V,
)
from labkit.engines.kernel.memory import allocate
from labkit.engines.kernel.neighbours import find_images, find_pairs, sort_grains
from labkit.grains.scene import Scene

GRAINS_PER_DOMAIN, MOST_DOMAINS = 3000, 16
GRAINS_PER_LARGE_DOMAIN, MOST_LARGE_DOMAINS = 20_000, 64  # thin domains have many images


class History(NamedTuple):
    """Contact history of pairs of grains.

    Args:
        pairs: Grains of each pair, (2, n), in any numbering.
        shift: Periodic shift of the second grain, (n, 3).
        rows: Values of the columns of history, (n, k).
        odd: True for values whose sign changes if the two grains are exchanged, (k,).
        number: Index of each grain of the State in the numbering of `pairs`, (grain,).
    """

    pairs: np.ndarray
    shift: np.ndarray
    rows: np.ndarray
    odd: np.ndarray
    number: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class PackedArrays:
    """The Arrays of the kernel (labkit.engines.kernel.layout) and the data needed to unpack them.

    `order` (grain,) is the index in the State of each grain of the kernel. For each pair, `slot` (n,) is its position
    in the blocks, `pairs` (2, n) are its grains in the order of the grid, and `pair_shift` (n, 3) is the shift of its
    second grain; `odd` is the field `odd` of History.
    """

    arrays: Arrays
    order: np.ndarray
    slot: np.ndarray
    pairs: np.ndarray
    pair_shift: np.ndarray
    odd: np.ndarray

    def unpack_grains(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position, velocity and spin of the grains of this rank, (grain, 3), in the order of the State."""
        arrays = self.arrays
        number = self.number[self.number < len(arrays.start)]
        position, motion = arrays.places.take(number, 0)[:, :3].copy(), arrays.motions.take(number, 0)
        return (
            position,
            host.take_rows(arrays.grains, V, number),
            np.array(motion[:, SITE_W : SITE_W + 3], float, order="C"),
        )

    def take_history(self, which: np.ndarray | slice) -> np.ndarray:
        """Return the history of some pairs, the field `rows` (n, k) of History."""
        return host.take_rows(self.arrays.blocks, HISTORY, self.slot[which])

    @functools.cached_property
    def number(self) -> np.ndarray:
        """Index in the kernel of each grain of the State, (grain,)."""
        number = np.empty_like(self.order)
        number[self.order] = np.arange(len(number))
        return number

    def unpack_history(self) -> History:
        """Return the History of all pairs, touching or not, with grain indices in the order of the grid."""
        rows = self.take_history(slice(None))
        return History(self.pairs, self.pair_shift, rows, self.odd, self.number)


def pack(
    scene: Scene,
    solids: np.ndarray,
    kinematics: Sequence[np.ndarray],
    history: History,
    cell: np.ndarray,
    cutoff: float,
    kind: type[np.floating],
    body: np.ndarray | None = None,
) -> PackedArrays:
    """Find all pairs closer than the cutoff and fill all arrays, except the sites of images.

    Grains of other MPI ranks have a 1/mass of 0. They do not move here, have no contacts with each other, and come last
    in the kernel. Their contacts form a domain of its own. Raises PhysicsError if a grain is lost.

    Args:
        scene: Scene of the grains.
        solids: Radius, 1/mass and 1/(moment of inertia), (grain, 3), in the order of the State.
        kinematics: Position, velocity and spin, (grain, 3), in the order of the State.
        history: History of the contacts so far.
        cell: Cell vectors as columns, (3, 3), in m.
        cutoff: Largest distance (m) between the surfaces of a pair.
        kind: Type of the numbers that may be single, np.float64 or np.float32.
        body: Body of each grain, (grain,); grains of the same body have no contacts with each other.
    """
    number = int(np.count_nonzero(solids[:, 1]))
    grid = sort_grains(kinematics[0], cell, 2.0 * solids[:, 0].max() + cutoff)
    order = grid.order.astype(np.intp, copy=False)
    position, radius = kinematics[0].take(order, 0), solids[:, 0].take(order)
    pairs, shift = find_pairs(position, radius, cell, grid, cutoff, None if body is None else body[order])
    small, large = number // GRAINS_PER_DOMAIN, number // GRAINS_PER_LARGE_DOMAIN
    domains = max(1, min(small, MOST_DOMAINS), min(large, MOST_LARGE_DOMAINS))
    grain_first = np.minimum(-(-number // (domains * WIDTH)) * WIDTH * np.arange(domains + 1, dtype=np.int64), number)
    first_pair = np.searchsorted(pairs[0], grain_first).astype(np.int64)
    if number < len(order):
        order, pairs, shift, across = foreign_last(order, solids[order, 1] == 0.0, pairs, shift)
        grain_first, first_pair = (np.array(ends, np.int64) for ends in ((0, number, number), (0, across, len(shift))))
    solids, position, velocity, spin = (values.take(order, 0) for values in (solids, *kinematics))
    radius = solids[:, 0].copy()
    counts = np.diff(first_pair)
    room = -(-counts // WIDTH) * WIDTH
    contact_first = np.cumsum(room) - room
    slot = np.arange(len(shift)) + np.repeat(contact_first - first_pair[:-1], counts.astype(np.intp, copy=False))
    blocks = max(1, int(room.sum()) // WIDTH)

    first_image = -(-len(order) // WIDTH) * WIDTH
    second, owner, image_shift = find_images(pairs, shift, grain_first, first_image)
    unused = first_image + len(owner)
    placed = np.full((2, blocks * WIDTH), unused, np.uint32)
    placed[0, slot], placed[1, slot] = pairs[0], second
    laid = allocate((blocks, 1 + history.rows.shape[1], WIDTH), kind)
    past = history._replace(rows=history.rows.astype(kind, copy=False), number=history.number[order])
    host.carry_history(past, pairs, shift, slot, scene.normal_stiffness(*radius.take(pairs)), laid)
    grain_blocks = -(-number // WIDTH)
    velocities = allocate((grain_blocks, GRAIN_ROWS * WIDTH))
    masses = allocate((grain_blocks, MASS_ROWS * WIDTH), kind)
    places, motions = allocate((unused + 1, PLACE_COLUMNS)), allocate((unused + 1, SITE_COLUMNS), kind)
    put_rows(velocities, velocity[:number])
    put_rows(masses, solids[:number, 1:])
    put_sites(places, motions, radius, position, velocity, spin)
    arrays = Arrays(
        grain_first=grain_first,
        contact_first=contact_first,
        contact_last=contact_first + counts,
        places=places,
        motions=motions,
        forces=allocate((unused + 1, FORCE_COLUMNS), kind),
        grains=velocities,
        masses=masses,
        image_first=np.searchsorted(owner, [*grain_first[:-1], len(order)]).astype(np.int64),
        owner=owner,
        shift=image_shift,
        pairs=placed,
        blocks=laid.reshape(blocks, -1),
        work=allocate((len(counts), WORK_ROWS * WIDTH), kind),
        doubles=allocate((len(counts), DOUBLE_ROWS * WIDTH)),
        start=position[:number],
    )
    return PackedArrays(arrays, order, slot, pairs, shift, history.odd)


def foreign_last(
    order: np.ndarray, foreign: np.ndarray, pairs: np.ndarray, shift: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return `order`, pairs and shifts with foreign grains last, and the number of pairs without a foreign grain.

    These pairs come first; pairs of two foreign grains are left out. The two ranks of any other pair list its grains
    in the same order, that of the State, so that they compute the same force.

    Args:
        order: Index in the State of each grain, (grain,).
        foreign: True for grains of other ranks, (grain,).
        pairs: Grains of each pair, (2, n).
        shift: Periodic shift of the second grain, (n, 3).
    """
    turn = np.argsort(foreign, kind="stable")
    place = np.empty_like(turn)
    place[turn] = np.arange(len(turn))
    order, pairs, outside = order.take(turn), place.take(pairs), foreign.take(pairs).sum(axis=0)
    backwards = (outside > 0) & (order.take(pairs[0]) > order.take(pairs[1]))
    pairs, shift = np.where(backwards, pairs[::-1], pairs), np.where(backwards[:, None], -shift, shift)
    by = np.argsort(outside, kind="stable")[: np.count_nonzero(outside < 2)]
    return order, pairs[:, by], shift.take(by, 0), int(np.count_nonzero(outside == 0))


def put_sites(
    places: np.ndarray,
    motions: np.ndarray,
    radius: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    spin: np.ndarray,
) -> None:
    """Write the grains to their sites, and give the last, unused site a radius.

    Each block is padded with contacts of the unused site with itself. They have no normal and no history, so their
    force is zero.
    """
    number = len(radius)
    places[:number, :3], motions[:number, SITE_V : SITE_V + 3] = position, velocity
    motions[:number, SITE_W : SITE_W + 3] = spin
    places[:number, PLACE_RADIUS] = motions[:number, SITE_RADIUS] = radius
    places[-1, PLACE_RADIUS] = motions[-1, SITE_RADIUS] = 1.0


def put_rows(blocks: np.ndarray, values: np.ndarray) -> None:
    """Write values (n, k) to the k rows of each block; blocks have the shape (block, k WIDTH)."""
    whole = np.zeros((len(blocks) * WIDTH, values.shape[1]))
    whole[: len(values)] = values
    blocks[:] = whole.reshape(len(blocks), WIDTH, -1).transpose(0, 2, 1).reshape(blocks.shape)
