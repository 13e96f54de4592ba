"""The arrays on the device.

The grains of all states lie one after the other, those of each state from a whole block on, so that all threads of a
block belong to one state. A grain is one thread. Vectors are stored by component, so that the threads of a warp read
consecutive numbers.

The neighbours of SLICE consecutive grains, a slice, are interleaved: the k-th neighbour of the grain i of a slice is
the entry SLICE k + i. Each state has two regions of entries: a search writes one from the other.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from labkit.engines.cuda.device import BLOCK, SLICE, cuda

# rows of the energies that a grain sums, in the order of a Ledger
CELL_WORK, FRICTION_LOSS, ROLLING_LOSS, DAMPING_LOSS, ENERGIES = range(5)

HISTORY = 6  # rows of history: tangential force and rolling moment
GRID_CELLS = 32  # most grid cells per grain


class DeviceArray(Protocol):
    """An array on the device, for which numba-cuda has no types; in kernels it is indexed like one of NumPy."""

    dtype: np.dtype
    shape: tuple[int, ...]
    ndim: int
    size: int
    nbytes: int

    def __getitem__(self, index: object) -> Any: ...

    def __setitem__(self, index: object, value: object) -> None: ...

    def __len__(self) -> int: ...

    def copy_to_host(self, *into: object, **options: object) -> np.ndarray:
        """Copies it to the host."""

    def copy_to_device(self, values: object, **options: object) -> None:
        """Copies values of the host, or of another array on the device, to it."""


class States(NamedTuple):
    """One row per state, n in all.

    first, grains (n,): first grain and number of grains; left, until (n,): steps left to do, and to the next
    correction of the velocity gradient; running (n,): 1 if the state
    takes part in the step; due (n,): 1 if it needs a search; time_step, skin, diameter, limit (n,): time step, s,
    Verlet skin and largest diameter, m, and square of the distance that a grain may move before a search, m2; factor
    (n,): of the stiffness kn of the contact law; disc (n,): radius of all grains in kn, m, in a planar scene, else 0;
    cell,
    first_cell, back, drift (n, 3, 3): cell, m, that of the last search, the inverse of the deformation since, and the
    velocity that a period adds, m/s; wanted, used, previous (n, 3, 3): velocity gradients of the coming steps, of the
    last step and of the one before, 1/s; law (n, k): parameters of the contact law (build.py).
    """

    first: DeviceArray
    grains: DeviceArray
    left: DeviceArray
    until: DeviceArray
    running: DeviceArray
    due: DeviceArray
    time_step: DeviceArray
    skin: DeviceArray
    diameter: DeviceArray
    limit: DeviceArray
    factor: DeviceArray
    disc: DeviceArray
    cell: DeviceArray
    first_cell: DeviceArray
    back: DeviceArray
    drift: DeviceArray
    wanted: DeviceArray
    used: DeviceArray
    previous: DeviceArray
    law: DeviceArray


class DeviceGrains(NamedTuple):
    """One column per grain, G in all with those that fill up blocks.

    state (G / BLOCK,): state of each block; number (G,): index in the State; radius, inverse_mass, inverse_inertia
    (G,); position, velocity, spin, force, torque, start (3, G): start is the position at the last search; energies
    (ENERGIES, G), J.
    """

    state: DeviceArray
    number: DeviceArray
    radius: DeviceArray
    inverse_mass: DeviceArray
    inverse_inertia: DeviceArray
    position: DeviceArray
    velocity: DeviceArray
    spin: DeviceArray
    force: DeviceArray
    torque: DeviceArray
    start: DeviceArray
    energies: DeviceArray


class Lists(NamedTuple):
    """Neighbour lists of all states, E entries in all.

    side (n,): which of its two regions a state uses, 0 or 1; region (2, n): first entry of each region; count (2, G):
    neighbours of a grain; slice_first (2, G / SLICE): first entry of a slice within its region; partner (E,):
    neighbour b, or ~b if b is the first grain of the contact; shift (3, E): its period relative to that of the grain;
    stiffness (E,): kn; history (HISTORY, E): on the first grain.
    """

    side: DeviceArray
    region: DeviceArray
    count: Any
    slice_first: DeviceArray
    partner: DeviceArray
    shift: DeviceArray
    stiffness: DeviceArray
    history: DeviceArray


class DeviceGrid(NamedTuple):
    """The grids of a search, C grid cells in all.

    searching (n,): 1 for states that are searched; first (n,): first grid cell of a state; shape, span (n, 3): as in
    labkit.engines.kernel.neighbours.Grid; inverse (n, 3, 3): of the cell, 1/m; needed (n,): entries that the lists of
    a state need; lost (n,): 1 if a grain is lost; begin, free (C,): first member of a grid cell, and the next one to
    write; members (G,): grains by grid cell, counted from the first of the state; grid_cell (G,): -1 for lost grains;
    period (3, G).
    """

    searching: DeviceArray
    first: DeviceArray
    shape: DeviceArray
    span: DeviceArray
    inverse: DeviceArray
    needed: DeviceArray
    lost: DeviceArray
    begin: DeviceArray
    free: DeviceArray
    members: DeviceArray
    grid_cell: DeviceArray
    period: DeviceArray


def zeros(shape: int | tuple[int, ...], kind: type = np.float64) -> DeviceArray:
    """An array of zeros on the device."""
    return cuda.to_device(np.zeros(shape, kind))


def new_states(first: np.ndarray, grains: np.ndarray, numbers: int) -> States:
    """States with these first grains and numbers of grains (n,); numbers: of a row of `law`."""
    n = len(first)
    counters, scalars = (zeros(n, np.int32) for _ in range(4)), (zeros(n) for _ in range(6))
    matrices = (zeros((n, 3, 3)) for _ in range(7))
    of_host = cuda.to_device(first), cuda.to_device(grains)
    return States._make((*of_host, *counters, *scalars, *matrices, zeros((n, numbers))))


def new_grains(state: np.ndarray) -> DeviceGrains:
    """Grains for these states of blocks (G / BLOCK,)."""
    g = BLOCK * len(state)
    scalars, vectors = (zeros(g) for _ in range(3)), (zeros((3, g)) for _ in range(6))
    of_blocks = cuda.to_device(state.astype(np.int32))
    return DeviceGrains._make((of_blocks, zeros(g, np.int32), *scalars, *vectors, zeros((ENERGIES, g))))


def new_lists(n: int, grains: int, kind: type = np.float64) -> Lists:
    """Lists of n states without room for neighbours; kind: type of stiffness and history."""
    of_states = zeros(n, np.int32), zeros((2, n), np.int64)
    of_grains = zeros((2, grains), np.int32), zeros((2, grains // SLICE), np.int64)
    of_entries = zeros(1, np.int32), zeros((3, 1), np.int16), zeros(1, kind), zeros((HISTORY, 1), kind)
    return Lists(*of_states, *of_grains, *of_entries)


def new_grid(count: np.ndarray, grains: int) -> DeviceGrid:
    """Grids for states of `count` (n,) grains, as many grid cells as labkit.engines.kernel.neighbours may need."""
    cells = GRID_CELLS * (count + 16) + 1
    n, c = len(count), int(cells.sum())
    return DeviceGrid(
        searching=zeros(n, np.int32),
        first=cuda.to_device(np.cumsum(cells) - cells),
        shape=zeros((n, 3), np.int32),
        span=zeros((n, 3), np.int32),
        inverse=zeros((n, 3, 3)),
        needed=zeros(n, np.int64),
        lost=zeros(n, np.int32),
        begin=zeros(c, np.int32),
        free=zeros(c, np.int32),
        members=zeros(grains, np.int32),
        grid_cell=zeros(grains, np.int32),
        period=zeros((3, grains), np.int32),
    )


def put(array: DeviceArray, first: int, values: np.ndarray) -> None:
    """Copy values (n,) or (k, n) to the columns of an array on the device from `first` on."""
    values = np.ascontiguousarray(values, array.dtype)
    if values.shape[-1]:
        rows = [(array, values)] if values.ndim == 1 else [(array[k], row) for k, row in enumerate(values)]
        for target, row in rows:
            target[first : first + len(row)].copy_to_device(row)


def rows_of(array: DeviceArray, first: int, count: int) -> list[DeviceArray]:
    """The parts (count,) of an array (n,) or of each row of one (k, n) on the device, from the column `first` on."""
    rows = [array] if array.ndim == 1 else [array[k] for k in range(array.shape[0])]
    return [row[first : first + count] for row in rows]
