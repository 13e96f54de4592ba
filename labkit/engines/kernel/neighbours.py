"""Neighbour search: sorts grains in space and finds all pairs closer than the cutoff, with their periodic shifts.

Grains are sorted into the cells of a grid that is skewed like the periodic cell. Each pair is found once, by the
grain that comes first in the order of the grid cells. The search includes periodic images: in a small periodic cell,
two grains that touch across two sides are found twice, as two pairs.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.kernel import host
from labkit.errors import PhysicsError
from labkit.micro.cells import widths

LOST = 1000  # periods; a grain farther away is treated as lost (the same number as in labkit/engines/host/search.hpp)
DIGIT = 16 * LOST  # more than twice the largest periodic shift of a pair
MOST_NEAR = 2e5  # grains with which a search may compare each grain, on average


def grid_shape(cell: np.ndarray, reach: float, grains: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of grid cells along each side, (3,), and the number of grid cells that `reach` spans, (3,).

    Grid cells are at least `reach` wide if the cell is large enough, and their number does not far exceed the number of
    grains. Raises PhysicsError for grains of which a search would compare too many pairs.
    """
    across = widths(cell)
    most = 2.0 * (4.0 * grains + 64.0) ** (1.0 / 3.0)
    shape = np.clip(np.floor(across / reach), 1.0, most)
    span = np.ceil(reach * shape / across * (1.0 - 1e-12))
    if not grains * np.prod((2.0 * span + 1.0) / shape) <= MOST_NEAR:
        raise PhysicsError(
            f"each of {grains:,} grains has too many others within {reach:.3g} m, as far as a contact reaches: the "
            "cell is too small, the largest grain too large for the others, or the cohesion too strong"
        )
    return shape.astype(np.int64), span.astype(np.int64)


@dataclasses.dataclass(frozen=True, eq=False)
class Grid:
    """Grains sorted into grid cells.

    order[k] is the k-th grain and period[k] (3,) the period that contains it. Grid cell c contains the grains k from
    start[c] to start[c + 1] - 1. A neighbour is at most span (3,) cells away in the grid of `shape` (3,).
    """

    order: np.ndarray
    period: np.ndarray
    start: np.ndarray
    shape: np.ndarray
    span: np.ndarray


def sort_grains(position: np.ndarray, cell: np.ndarray, reach: float) -> Grid:
    """Sort grains (grain, 3) into a Grid for pairs closer than `reach` (m). Raises PhysicsError if a grain is lost."""
    shape, span = grid_shape(cell, reach, len(position))
    placed = host.place_in_grid(position, np.linalg.inv(cell), shape)
    if placed is None:
        raise PhysicsError("a grain is lost or its position became NaN: the time step is too large")
    period, grid_cell = placed
    start, order = host.sort_by_number(grid_cell, int(shape.prod()))
    return Grid(order, period[order], start, shape, span)


def find_pairs(
    position: np.ndarray,
    radius: np.ndarray,
    cell: np.ndarray,
    grid: Grid,
    cutoff: float,
    body: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs (2, n) of grains closer than `cutoff` and the periodic shifts of their second grains (n, 3).

    position (grain, 3), radius (grain,) and the indices in the pairs follow the order of the grid. Two spheres
    of the same clump, given by `body` (grain,), are not a pair, but a sphere of a clump and a sphere of its periodic
    image are.
    """
    grains = np.empty((len(radius), 4))
    grains[:, :3] = position - grid.period @ cell.T
    grains[:, 3] = radius
    pairs, shifts = host.search_grid(grains, cell, grid, cutoff)
    if body is not None:
        apart = (body[pairs[0]] != body[pairs[1]]) | shifts.any(axis=1)
        pairs, shifts = pairs[:, apart], shifts[apart]
    return pairs.copy(), shifts.copy()


def find_images(
    pairs: np.ndarray, shift: np.ndarray, grain_first: np.ndarray, first_image: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the site of the second grain of each pair (n,), and the owners (image,) and shifts (image, 3) of images.

    The second grain of a pair has an image, a separate site numbered from `first_image`, if it lies in another period
    or domain than the first grain. Images are sorted by owner, domain and shift.

    Args:
        pairs: Grains of each pair, (2, n), sorted by the first.
        shift: Periodic shift of the second grain, (n, 3).
        grain_first: First grain of each domain, (domain + 1,).
        first_image: Index of the first image.
    """
    domain, own = DIGIT**3 * (pairs // grain_first[1]).astype(np.int64)
    # combines domain and shift in one number
    key = domain + shift.astype(np.int64) @ DIGIT ** np.array([2, 1, 0], np.int64)
    needed = np.flatnonzero(key != own)
    needed = needed.take(np.lexsort((key.take(needed), pairs[1].take(needed))))
    site, key = pairs[1].astype(np.int64), key.take(needed)
    owner = site.take(needed)
    differs = np.ones(len(needed), bool)
    differs[1:] = (owner[1:] != owner[:-1]) | (key[1:] != key[:-1])
    site[needed] = first_image + np.cumsum(differs) - 1
    return site, owner[differs], shift.take(needed[differs], 0).astype(float)
