"""Neighbour search: sorts grains in space, and finds all pairs closer than a margin, with their periodic shifts.

Grains are sorted into the cells of a grid that is skewed like the periodic cell. Each pair is found once, from the
grain that comes first in the order of the grid cells. The search includes periodic images: in a small periodic cell,
two grains that meet across two sides are found twice, as two pairs.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.kernel.arranging import LOST, by_number
from labkit.engines.kernel.compiling import compile_and_keep, compile_callee
from labkit.errors import PhysicsError
from labkit.micro.cells import widths


def grid_shape(cell: np.ndarray, reach: float, grains: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of grid cells along each side, (3,), and the number that `reach` spans, (3,).

    Grid cells are at least `reach` wide if space permits, and there are not many more of them than grains.
    """
    across = widths(cell)
    most = 2.0 * (4.0 * grains + 64.0) ** (1.0 / 3.0)
    shape = np.clip(np.floor(across / reach), 1, most).astype(np.int64)
    return shape, np.ceil(reach * shape / across * (1.0 - 1e-12)).astype(np.int64)


@compile_and_keep
def place(
    position: np.ndarray, inverse_cell: np.ndarray, shape: np.ndarray, period: np.ndarray, grid_cell: np.ndarray
) -> bool:
    """Write the period (grain, 3) and the grid cell (grain,) of each grain in place.

    Returns False if a grain is lost, that is, its position (grain, 3) is NaN or too far away.
    """
    for g in range(len(position)):
        index = 0
        for k in range(2, -1, -1):
            fraction = 0.0
            for j in range(3):
                fraction += inverse_cell[k, j] * position[g, j]
            if not abs(fraction) < LOST:
                return False
            whole = np.floor(fraction)
            period[g, k] = int(whole)
            index = index * shape[k] + min(int((fraction - whole) * shape[k]), shape[k] - 1)
        grid_cell[g] = index
    return True


@compile_callee
def runs_around(c: int, shape: np.ndarray, span: np.ndarray, runs: np.ndarray) -> int:
    """Write the grid cells that follow cell c within `span` (3,), in order; return the number of rows written.

    A row of `runs` is a run of consecutive cells: the first, the last, and the period (3) in which they lie. The first
    run starts with c itself.
    """
    cx, cy, cz = c % shape[0], c // shape[0] % shape[1], c // (shape[0] * shape[1])
    number = 0
    for oz in range(0, span[2] + 1):
        for oy in range(-span[1] if oz > 0 else 0, span[1] + 1):
            for ox in range(-span[0] if oz > 0 or oy > 0 else 0, span[0] + 1):
                px, py, pz = (cx + ox) // shape[0], (cy + oy) // shape[1], (cz + oz) // shape[2]
                other = cx + ox - px * shape[0]
                other += shape[0] * (cy + oy - py * shape[1] + shape[1] * (cz + oz - pz * shape[2]))
                last = runs[number - 1]
                same = number > 0 and other == last[1] + 1 and px == last[2] and py == last[3] and pz == last[4]
                if same:
                    last[1] = other
                else:
                    row = runs[number]
                    row[0], row[1], row[2], row[3], row[4] = other, other, px, py, pz
                    number += 1
    return number


@compile_and_keep
def find(
    grains: np.ndarray,
    cell: np.ndarray,
    period: np.ndarray,
    start: np.ndarray,
    shape: np.ndarray,
    span: np.ndarray,
    margin: float,
    runs: np.ndarray,
    pairs: np.ndarray,
    shifts: np.ndarray,
) -> int:
    """Find all pairs of grains whose surfaces are closer than `margin`; return their number, or -1 for lack of room.

    Args:
        grains: Positions wrapped into the cell, and radii, (n, 4), in the order of the grid cells.
        cell: (3, 3), m.
        period: Period of each grain, (n, 3), in the same order.
        start: First grain of each grid cell.
        shape: Number of grid cells along each side, (3,).
        span: Distance of the farthest neighbour in grid cells, (3,).
        margin: m.
        runs: Memory for the runs around a grid cell, (product of 2 span + 1, 5).
        pairs: Filled with the pairs, (2, capacity).
        shifts: Filled with the periodic shifts of the second grains, (capacity, 3).
    """
    count = 0
    capacity = pairs.shape[1]
    origin = np.empty((len(runs), 3))  # corner of the period in which a run lies
    for c in range(len(start) - 1):
        number = runs_around(c, shape, span, runs) if start[c] < start[c + 1] else 0
        for r in range(number):
            for k in range(3):
                origin[r, k] = cell[k, 0] * runs[r, 2] + cell[k, 1] * runs[r, 3] + cell[k, 2] * runs[r, 4]
        for a in range(start[c], start[c + 1]):
            ra = grains[a, 3] + margin
            found = count
            for r in range(number):
                x, y, z = grains[a, 0] - origin[r, 0], grains[a, 1] - origin[r, 1], grains[a, 2] - origin[r, 2]
                begin, end = a + 1 if r == 0 else start[runs[r, 0]], start[runs[r, 1] + 1]
                if count + end - begin > capacity:
                    return -1
                for b in range(begin, end):  # without branches, which the processor could not predict
                    dx, dy, dz = grains[b, 0] - x, grains[b, 1] - y, grains[b, 2] - z
                    reach = ra + grains[b, 3]
                    pairs[0, count], pairs[1, count] = r, b
                    count += dx * dx + dy * dy + dz * dz < reach * reach
            for pair in range(found, count):
                r, b = pairs[0, pair], pairs[1, pair]
                pairs[0, pair] = a
                for k in range(3):
                    shifts[pair, k] = runs[r, 2 + k] + period[a, k] - period[b, k]
    return count


@dataclasses.dataclass(frozen=True)
class Grid:
    """Grains sorted into grid cells.

    order[k] is the k-th grain and period[k] (3,) the period that contains it. Grid cell c holds k from start[c] to
    start[c + 1] - 1. A neighbour is at most span (3,) cells away in the grid of `shape` (3,).
    """

    order: np.ndarray
    period: np.ndarray
    start: np.ndarray
    shape: np.ndarray
    span: np.ndarray


def sort_grains(position: np.ndarray, cell: np.ndarray, reach: float) -> Grid:
    """Sort grains (grain, 3) into a Grid for pairs closer than `reach`, m. Raises PhysicsError if a grain is lost."""
    shape, span = grid_shape(cell, reach, len(position))
    period = np.empty((len(position), 3), np.int64)
    grid_cell = np.empty(len(position), np.int64)
    if not place(position, np.linalg.inv(cell), shape, period, grid_cell):
        raise PhysicsError("a grain is lost or its position became NaN: the time step is too large")
    start, order = by_number(grid_cell, int(shape.prod()))
    return Grid(order, period[order], start, shape, span)


def find_pairs(
    position: np.ndarray,
    radius: np.ndarray,
    cell: np.ndarray,
    grid: Grid,
    margin: float,
    body: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs (2, n) of grains closer than `margin` and the periodic shifts of their second grains (n, 3).

    position (grain, 3), radius (grain,) and the indices in the pairs follow the order of the grid. Grains of the same
    `body` (grain,), a clump, are no pair, but those of a clump and its own image are.
    """
    grains = np.empty((len(radius), 4))
    grains[:, :3] = position - grid.period @ cell.T
    grains[:, 3] = radius
    runs = np.empty((int((2 * grid.span + 1).prod()), 5), np.int64)
    capacity = 4 * len(position) + 64
    while True:
        pairs, shifts = np.empty((2, capacity), np.int32), np.empty((capacity, 3), np.int32)
        count = find(grains, cell, grid.period, grid.start, grid.shape, grid.span, margin, runs, pairs, shifts)
        if count >= 0:
            pairs, shifts = pairs[:, :count], shifts[:count]
            if body is not None:
                apart = (body[pairs[0]] != body[pairs[1]]) | shifts.any(axis=1)
                pairs, shifts = pairs[:, apart], shifts[apart]
            return pairs.copy(), shifts.copy()
        capacity *= 2
