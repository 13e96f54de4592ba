"""Kernels of the neighbour search of the states for which Grid.searching is 1.

labkit.engines.kernel.neighbours describes the grid. Grains are counted per grid cell with integer atomics, so their
order within a grid cell is arbitrary. Each list is then sorted by the number of the neighbour in its State. The lists,
and with them all sums of forces, therefore depend neither on that order nor on when searches take place.
"""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.cuda.arrays import HISTORY, DeviceArray, DeviceGrains, DeviceGrid, Lists, States
from labkit.engines.cuda.device import BLOCK, SLICE, cuda
from labkit.engines.kernel.arranging import LOST
from labkit.engines.kernel.compiling import Untyped

stiffness_of: Untyped = None  # stiffness of the law's normal part, set by labkit.engines.cuda.build
PARTIAL = BLOCK + 1  # sums of the threads of a block, and their total


def exclusive_sums(partial: DeviceArray, t: int) -> int:
    """Replace partial (PARTIAL,), shared by the threads t of a block, by its exclusive sums; return the total."""
    cuda.syncthreads()
    if t == 0:
        total = 0
        for k in range(BLOCK):
            total, partial[k] = total + partial[k], total
        partial[BLOCK] = total
    cuda.syncthreads()
    return partial[BLOCK]


def clear(grid: DeviceGrid) -> None:
    """Set the grid cells of a state to empty. One block per state."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    if grid.searching[s] == 0:
        return
    first = grid.first[s]
    cells = grid.shape[s, 0] * grid.shape[s, 1] * grid.shape[s, 2]
    for c in range(t, cells + 1, BLOCK):
        grid.free[first + c] = 0


def find_cells(states: States, grains: DeviceGrains, grid: DeviceGrid) -> None:
    """Find the grid cell and the period of each grain, and count the grains of each grid cell. One thread per grain."""
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if grid.searching[s] == 0 or g - states.first[s] >= states.grains[s]:
        return
    index, lost = 0, False
    for k in range(2, -1, -1):
        fraction = 0.0
        for j in range(3):
            fraction += grid.inverse[s, k, j] * grains.position[j, g]
        if abs(fraction) < LOST:
            whole = math.floor(fraction)
            grid.period[k, g] = int(whole)
            index = index * grid.shape[s, k] + min(int((fraction - whole) * grid.shape[s, k]), grid.shape[s, k] - 1)
        else:
            lost = True
        grains.start[k, g] = grains.position[k, g]
    if lost:
        grid.lost[s] = 1
        grid.grid_cell[g] = -1
    else:
        grid.grid_cell[g] = index
        cuda.atomic.add(grid.free, grid.first[s] + index, 1)


def offsets(grid: DeviceGrid) -> None:
    """Find the first member of each grid cell of a state. One block per state."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    partial = cuda.shared.array(PARTIAL, np.int64)
    if grid.searching[s] == 0:
        return
    first = grid.first[s]
    cells = grid.shape[s, 0] * grid.shape[s, 1] * grid.shape[s, 2]
    share = (cells + BLOCK - 1) // BLOCK
    own = 0
    for c in range(t * share, min(cells, (t + 1) * share)):
        own += grid.free[first + c]
    partial[t] = own
    total = exclusive_sums(partial, t)
    sum_before = partial[t]
    for c in range(t * share, min(cells, (t + 1) * share)):
        count = grid.free[first + c]
        grid.begin[first + c] = grid.free[first + c] = sum_before
        sum_before += count
    if t == 0:
        grid.begin[first + cells] = total


def sort(states: States, grains: DeviceGrains, grid: DeviceGrid) -> None:
    """Enter the grains in their grid cells. One thread per grain."""
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if grid.searching[s] == 0 or g - states.first[s] >= states.grains[s] or grid.grid_cell[g] < 0:
        return
    place = cuda.atomic.add(grid.free, grid.first[s] + grid.grid_cell[g], 1)
    grid.members[states.first[s] + place] = g - states.first[s]


def comes_before(grains: DeviceGrains, lists: Lists, one: int, other: int) -> bool:
    """True if entry `one` precedes `other` in a list sorted by number of the neighbour, then by shift in z, y, x."""
    b, c = lists.partner[one], lists.partner[other]
    b, c = grains.number[b if b >= 0 else ~b], grains.number[c if c >= 0 else ~c]
    if b != c:
        return b < c
    for k in range(2, -1, -1):
        if lists.shift[k, one] != lists.shift[k, other]:
            return lists.shift[k, one] < lists.shift[k, other]
    return False


def enter(grains: DeviceGrains, lists: Lists, base: int, k: int, neighbour: int, x: int, y: int, z: int) -> None:
    """Insert a neighbour, with its shift, at its place in a sorted list of k entries that starts at `base`."""
    at = base + SLICE * k
    lists.partner[at] = neighbour
    lists.shift[0, at], lists.shift[1, at], lists.shift[2, at] = x, y, z
    while k > 0 and comes_before(grains, lists, at, at - SLICE):
        lists.partner[at], lists.partner[at - SLICE] = lists.partner[at - SLICE], lists.partner[at]
        for j in range(3):
            lists.shift[j, at], lists.shift[j, at - SLICE] = lists.shift[j, at - SLICE], lists.shift[j, at]
        at -= SLICE
        k -= 1


def neighbours(
    states: States, grains: DeviceGrains, lists: Lists, grid: DeviceGrid, s: int, g: int, base: int, write: bool
) -> int:
    """Count the neighbours of grain g of state s, those closer than the skin; if `write`, enter them in its list."""
    count, first, cells = 0, states.first[s], grid.first[s]
    nx, ny, nz = grid.shape[s, 0], grid.shape[s, 1], grid.shape[s, 2]
    c = grid.grid_cell[g]
    cx, cy, cz = c % nx, c // nx % ny, c // (nx * ny)
    for oz in range(cz - grid.span[s, 2], cz + grid.span[s, 2] + 1):
        for oy in range(cy - grid.span[s, 1], cy + grid.span[s, 1] + 1):
            for ox in range(cx - grid.span[s, 0], cx + grid.span[s, 0] + 1):
                px, py, pz = ox // nx, oy // ny, oz // nz
                other = cells + ox - px * nx + nx * (oy - py * ny + ny * (oz - pz * nz))
                for m in range(grid.begin[other], grid.begin[other + 1]):
                    b = first + grid.members[first + m]
                    x = px + grid.period[0, g] - grid.period[0, b]
                    y = py + grid.period[1, g] - grid.period[1, b]
                    z = pz + grid.period[2, g] - grid.period[2, b]
                    reach, squared = grains.radius[g] + grains.radius[b] + states.skin[s], 0.0
                    for k in range(3):
                        d = grains.position[k, b] - grains.position[k, g]
                        d += states.cell[s, k, 0] * x + states.cell[s, k, 1] * y + states.cell[s, k, 2] * z
                        squared += d * d
                    if squared < reach * reach and not (b == g and x == 0 and y == 0 and z == 0):
                        if write:
                            is_first = grains.number[g] < grains.number[b]
                            if b == g:
                                is_first = x > 0 or (x == 0 and (y > 0 or (y == 0 and z > 0)))
                            enter(grains, lists, base, count, b if is_first else ~b, x, y, z)
                        count += 1
    return count


def count_neighbours(states: States, grains: DeviceGrains, lists: Lists, grid: DeviceGrid) -> None:
    """Count the neighbours of each grain. One thread per grain, including those that fill up blocks."""
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if grid.searching[s] == 0:
        return
    found = 0
    if g - states.first[s] < states.grains[s] and grid.grid_cell[g] >= 0:
        found = neighbours(states, grains, lists, grid, s, g, 0, False)
    lists.count[1 - lists.side[s], g] = found


def arrange(states: States, lists: Lists, grid: DeviceGrid) -> None:
    """Find the first entry of each slice of a state, and the number of entries needed. One block per state."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    partial = cuda.shared.array(PARTIAL, np.int64)
    if grid.searching[s] == 0:
        return
    new, first = 1 - lists.side[s], states.first[s] // SLICE
    slices = (states.grains[s] + SLICE - 1) // SLICE
    share = (slices + BLOCK - 1) // BLOCK
    own = 0
    for k in range(first + t * share, first + min(slices, (t + 1) * share)):
        own += longest(lists, new, k) * SLICE
    partial[t] = own
    total = exclusive_sums(partial, t)
    sum_before = partial[t]
    for k in range(first + t * share, first + min(slices, (t + 1) * share)):
        lists.slice_first[new, k] = sum_before
        sum_before += longest(lists, new, k) * SLICE
    if t == 0:
        grid.needed[s] = total


def longest(lists: Lists, side: int, k: int) -> int:
    """Largest number of neighbours of a grain in slice k."""
    most = 0
    for g in range(k * SLICE, (k + 1) * SLICE):
        most = max(most, lists.count[side, g])
    return most


def fill(states: States, grains: DeviceGrains, lists: Lists, grid: DeviceGrid) -> None:
    """Write the list of each grain, and keep the history of neighbours already in its old list. One thread per grain.

    The contact law gives the stiffness kn, called with the first grain of the contact first.
    """
    g, s = cuda.grid(1), grains.state[cuda.blockIdx.x]
    if grid.searching[s] == 0 or g - states.first[s] >= states.grains[s] or grid.grid_cell[g] < 0:
        return
    old, new = lists.side[s], 1 - lists.side[s]
    base = lists.region[new, s] + lists.slice_first[new, g // SLICE] + g % SLICE
    found = neighbours(states, grains, lists, grid, s, g, base, True)
    before = lists.region[old, s] + lists.slice_first[old, g // SLICE] + g % SLICE
    end = before + SLICE * lists.count[old, g]
    for at in range(base, base + SLICE * found, SLICE):
        b = lists.partner[at]
        one, two = (g, b) if b >= 0 else (~b, g)
        disc = states.disc[s]
        a, c = (disc, disc) if disc > 0.0 else (grains.radius[one], grains.radius[two])
        lists.stiffness[at] = stiffness_of(states.factor[s], a, c)
        while before < end and comes_before(grains, lists, before, at):
            before += SLICE
        same = before < end and not comes_before(grains, lists, at, before)
        for k in range(HISTORY):
            lists.history[k, at] = lists.history[k, before] if same else 0.0
