"""The arrays on the device.

The grains of all states are stored one after the other. Those of each state start a new block, so that all threads of
a block belong to one state. Each grain has one thread. Vectors are stored by component, so that the threads of a warp
read consecutive numbers.

The neighbours of SLICE consecutive grains, a slice, are interleaved: the k-th neighbour of the grain i of a slice is
the entry SLICE k + i. Each state has two regions of entries: a search writes one from the other.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from labkit.engines.cuda.device import BLOCK, SLICE, cuda

# rows of the energies summed per grain, in the order of a Ledger
CELL_WORK, FRICTION_LOSS, ROLLING_LOSS, DAMPING_LOSS, ENERGIES = range(5)

HISTORY = 6  # rows of history: tangential force and rolling moment
GRID_CELLS = 32  # maximum number of grid cells per grain


class DeviceArray(Protocol):
    """An array on the device, for which numba-cuda has no type; kernels index it like a NumPy array."""

    dtype: np.dtype
    shape: tuple[int, ...]
    ndim: int
    size: int
    nbytes: int

    def __getitem__(self, index: object) -> Any: ...

    def __setitem__(self, index: object, value: object) -> None: ...

    def __len__(self) -> int: ...

    def copy_to_host(self, *into: object, **options: object) -> np.ndarray:
        """Copy it to the host."""

    def copy_to_device(self, values: object, **options: object) -> None:
        """Copy values to it from the host, or from another array on the device."""


class States(NamedTuple):
    """One row per state, n in all.

    Args:
        first: First grain, (n,).
        grains: Number of grains, (n,).
        left: Steps left to do, (n,).
        until: Steps until the next correction of the velocity gradient, (n,).
        running: 1 if the state takes part in the step, (n,).
        due: 1 if the state needs a search, (n,).
        time_step: Time step, (n,), s.
        skin: Verlet skin, (n,), m.
        diameter: Largest diameter, (n,), m.
        limit: Square of the distance that a grain may move before a search, (n,), m2.
        factor: Factor of the stiffness kn of the contact law, (n,).
        disc: Radius of all grains in kn in a planar scene, otherwise 0, (n,), m.
        cell: Cell, (n, 3, 3), m.
        first_cell: Cell at the last search, (n, 3, 3), m.
        back: Inverse of the deformation since the last search, (n, 3, 3).
        drift: Velocity that a period adds, (n, 3, 3), m/s.
        wanted: Velocity gradient of the coming steps, (n, 3, 3), 1/s.
        used: Velocity gradient of the last step, (n, 3, 3), 1/s.
        previous: Velocity gradient of the step before, (n, 3, 3), 1/s.
        law: Parameters of the contact law (build.py), (n, k).
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
    """One column per grain, G in all including those that fill up blocks; SI units.

    Args:
        state: State to which each block belongs, (G / BLOCK,).
        number: Index in the State, (G,).
        radius: Radius, (G,).
        inverse_mass: 1/m, (G,).
        inverse_inertia: 1/I, (G,).
        position: Position, (3, G).
        velocity: Velocity, (3, G).
        spin: Angular velocity, (3, G).
        force: Force, (3, G).
        torque: Torque, (3, G).
        start: Position at the last search, (3, G).
        energies: Energy sums, (ENERGIES, G), J.
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

    Args:
        side: Region that a state uses, 0 or 1, (n,).
        region: First entry of each region, (2, n).
        count: Number of neighbours of a grain, (2, G).
        slice_first: First entry of a slice within its region, (2, G / SLICE).
        partner: Neighbour b, or ~b if b is the first grain of the contact, (E,).
        shift: Period of the neighbour relative to that of the grain, (3, E).
        stiffness: Normal stiffness kn, (E,), N/m.
        history: Tangential force and rolling moment on the first grain, (HISTORY, E), N and N m.
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

    Args:
        searching: 1 for states that are searched, (n,).
        first: First grid cell of a state, (n,).
        shape: Number of grid cells along each side (labkit.engines.kernel.neighbours.Grid), (n, 3).
        span: Distance of the farthest neighbour in grid cells, (n, 3).
        inverse: Inverse of the cell, (n, 3, 3), 1/m.
        needed: Number of entries that the lists of a state need, (n,).
        lost: 1 if a grain is lost, (n,).
        begin: First member of a grid cell, (C,).
        free: Next member of a grid cell to write, (C,).
        members: Grains by grid cell, counted from the first grain of the state, (G,).
        grid_cell: Grid cell of each grain, -1 for lost grains, (G,).
        period: Period in which each grain lies, (3, G).
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
    """Return an array of zeros on the device."""
    return cuda.to_device(np.zeros(shape, kind))


def new_states(first: np.ndarray, grains: np.ndarray, numbers: int) -> States:
    """Allocate States.

    Args:
        first: First grain of each state, (n,).
        grains: Number of grains of each state, (n,).
        numbers: Length of a row of `law`.
    """
    n = len(first)
    counters, scalars = (zeros(n, np.int32) for _ in range(4)), (zeros(n) for _ in range(6))
    matrices = (zeros((n, 3, 3)) for _ in range(7))
    of_host = cuda.to_device(first), cuda.to_device(grains)
    return States._make((*of_host, *counters, *scalars, *matrices, zeros((n, numbers))))


def new_grains(state: np.ndarray) -> DeviceGrains:
    """Allocate grains; `state` (G / BLOCK,) is the state of each block."""
    g = BLOCK * len(state)
    scalars, vectors = (zeros(g) for _ in range(3)), (zeros((3, g)) for _ in range(6))
    of_blocks = cuda.to_device(state.astype(np.int32))
    return DeviceGrains._make((of_blocks, zeros(g, np.int32), *scalars, *vectors, zeros((ENERGIES, g))))


def new_lists(n: int, grains: int, kind: type = np.float64) -> Lists:
    """Allocate the lists of n states without room for neighbours; `kind` is the type of stiffness and history."""
    of_states = zeros(n, np.int32), zeros((2, n), np.int64)
    of_grains = zeros((2, grains), np.int32), zeros((2, grains // SLICE), np.int64)
    of_entries = zeros(1, np.int32), zeros((3, 1), np.int16), zeros(1, kind), zeros((HISTORY, 1), kind)
    return Lists(*of_states, *of_grains, *of_entries)


def new_grid(count: np.ndarray, grains: int) -> DeviceGrid:
    """Allocate grids for states of `count` (n,) grains, with as many grid cells as the search may need."""
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
    """Copy values (n,) or (k, n) to the columns of an array on the device, starting at column `first`."""
    values = np.ascontiguousarray(values, array.dtype)
    if values.shape[-1]:
        rows = [(array, values)] if values.ndim == 1 else [(array[k], row) for k, row in enumerate(values)]
        for target, row in rows:
            target[first : first + len(row)].copy_to_device(row)


def rows_of(array: DeviceArray, first: int, count: int) -> list[DeviceArray]:
    """Return `count` columns, starting at `first`, of each row of an array (n,) or (k, n) on the device."""
    rows = [array] if array.ndim == 1 else [array[k] for k in range(array.shape[0])]
    return [row[first : first + count] for row in rows]
