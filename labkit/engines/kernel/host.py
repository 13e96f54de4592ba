"""Calls the C++ library in labkit/engines/host with NumPy arrays: time steps and neighbour search.

This module checks types, shapes, memory order and indices; the library checks nothing.
"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.engines.host import build
from labkit.engines.kernel.layout import COMPILED, INTEGER, POINTER, REAL, WIDTH
from labkit.errors import InputError, PhysicsError
from labkit.files.caches import cache_folder
from labkit.micro.cells import MOST_OF_A_GRAIN, MOST_PAIRS
from labkit.once import once

if TYPE_CHECKING:
    from labkit.engines.kernel.neighbours import Grid
    from labkit.engines.kernel.packing import History

NO_MEMORY = -(2**63)  # result of a function of the library that had no memory


@once
def library() -> ctypes.CDLL:
    """Load the library, and compile it first if necessary. Raises InputError."""
    host_library = load_library(library_file())
    require_layout(host_library)
    return host_library


def require_layout(host_library: ctypes.CDLL) -> None:
    """Raise InputError if the numbers and structs of the library differ from those that labkit uses."""
    for name, numbers in COMPILED.items():
        if tuple((ctypes.c_int64 * len(numbers)).in_dll(host_library, name)) != numbers:
            raise InputError(
                f"labkit/engines/kernel/layout.py and {name} in labkit/engines/host differ: install labkit again"
            )


def load_library(file: Path) -> ctypes.CDLL:
    """Load a copy of the library in memory, which nobody can change while it is in use. Raises InputError."""
    content = build.read_whole(file)
    if content is None:
        raise InputError(f"{file} is damaged: delete it, and give the same command again")
    try:
        number = os.memfd_create(file.name)  # stays open: the dynamic linker knows the library by this path
        with open(number, "wb", closefd=False) as copy:
            copy.write(content)
        return ctypes.CDLL(f"/proc/self/fd/{number}")
    except (AttributeError, OSError):  # only Linux has such files
        return _load_file(file)


def _load_file(file: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(file))
    except OSError as error:
        raise InputError(f"the kernel of labkit cannot be loaded: {error}") from None


def library_file() -> Path:
    """Return the path of the library: in the package, or in the user's cache if the package is not writable."""
    file = build.HERE / build.library_name()
    if build.read_whole(file):
        return file
    folder = build.HERE if os.access(build.HERE, os.W_OK) else cache_folder("compiled")
    if folder is None:
        raise InputError(f"the kernel of labkit is not compiled, and {build.HERE} cannot be written")
    try:
        return build.build_host(folder)
    except build.CannotCompile as error:
        raise InputError(str(error)) from error


@once
def level() -> str:
    """Return the highest level of instructions that this processor supports."""
    return {4: "v4", 3: "v3"}.get(call_common("processor_level"), "plain")


def precision_of(kind: np.dtype) -> str:
    """Return the suffix of the library's functions for a type of number."""
    return "single" if kind == np.float32 else "double"


def call(name: str, *values: Any) -> int:
    """Call a function of the library with contiguous arrays, structures, integers and floats. Raises MemoryError."""
    result = call_common(f"{name}_{level()}", *values)
    if result == NO_MEMORY:
        raise MemoryError("the memory does not suffice for so many grains")
    return result


def call_common(name: str, *values: Any) -> int:
    """Call a function that is the same for all levels of instructions."""
    function = getattr(library(), name)
    function.restype = INTEGER
    return int(function(*map(_pass, values)))


def address_in_library(name: str) -> int:
    """Return the address of a function that labkit.engines.kernel.ship linked into the library; 0 if there is none."""
    function = getattr(library(), name, None)
    return (function and ctypes.cast(function, POINTER).value) or 0


def _pass(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError(f"an array {value.shape} is not contiguous")
        return POINTER(value.ctypes.data)
    if isinstance(value, float):
        return REAL(value)
    if isinstance(value, int):
        return INTEGER(value)
    return value if isinstance(value, POINTER) else ctypes.byref(value)


def as_array(kind: type, values: Any, *shape: int) -> np.ndarray:
    """Return values as a contiguous array of a type and shape. Raises ValueError for a different shape."""
    array: np.ndarray = np.ascontiguousarray(values, kind)
    if array.shape != shape:
        raise ValueError(f"an array has the shape {array.shape}, not {shape}")
    return array


def as_indices(kind: type, values: Any, below: int, *shape: int) -> np.ndarray:
    """Return integers from 0 to below - 1 as a contiguous array of a type and shape. Raises ValueError for others."""
    array = as_array(kind, values, *shape)
    if array.min(initial=0) < 0 or array.max(initial=-1) >= below:
        raise ValueError(f"an array contains indices that are not from 0 to {below - 1}")
    return array


def sort_by_number(numbers: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort integers (n,) from 0 to most - 1; equal integers keep their order.

    Returns `start` (most + 1,) and `order` (n,): order[start[k]] to order[start[k + 1] - 1] are the entries equal to k.
    """
    numbers = as_indices(np.int64, numbers, most, len(numbers))
    start, order = np.empty(most + 1, np.int64), np.empty(len(numbers), np.int64)
    call("sort_by_number", numbers, len(numbers), most, start, order)
    return start, order


def place_in_grid(
    position: np.ndarray, inverse_cell: np.ndarray, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the period (grain, 3) and the grid cell (grain,) of each grain, or None if a grain is lost.

    Args:
        position: Positions, (grain, 3), in m.
        inverse_cell: Inverse of the cell, (3, 3), in 1/m.
        shape: Number of grid cells along each side, (3,).
    """
    n = len(position)
    period, grid_cell = np.empty((n, 3), np.int64), np.empty(n, np.int64)
    arrays = as_array(float, position, n, 3), n, as_array(float, inverse_cell, 3, 3), as_array(np.int64, shape, 3)
    return (period, grid_cell) if call("place_in_grid", *arrays, period, grid_cell) else None


def search_grid(grains: np.ndarray, cell: np.ndarray, grid: Grid, cutoff: float) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs (2, n) of grains whose surfaces are closer than the cutoff, and their periodic shifts (n, 3).

    Args:
        grains: Positions wrapped into the cell, and radii, (grain, 4), in the order of the grid.
        cell: Cell vectors as columns, (3, 3), in m.
        grid: The grains sorted into grid cells.
        cutoff: Largest distance (m) between the surfaces of a pair.

    Raises PhysicsError if there are more pairs than a computer can simulate.
    """
    most, cells = max(MOST_PAIRS, MOST_OF_A_GRAIN * len(grains)), len(grid.start) - 1
    if cells != grid.shape.prod() or grid.start[-1] != len(grains):
        raise ValueError("the grid does not contain the grains")
    grains, cell = as_array(float, grains, len(grains), 4), as_array(float, cell, 3, 3)
    capacity = 4 * len(grains) + 64
    while True:
        pairs, shifts = np.empty((2, capacity), np.int32), np.empty((capacity, 3), np.int32)
        sorted_grains = grains, cell, grid.period, grid.start, cells, grid.shape, grid.span
        count = call("find_pairs", *sorted_grains, float(cutoff), pairs[0], pairs[1], shifts, capacity)
        if count >= 0:
            return pairs[:, :count], shifts[:count]
        if capacity > most:
            raise PhysicsError(
                f"more than {most:,} pairs of grains are in contact or nearly so: the cell is too small for the grains"
            )
        capacity *= 2


def carry_history(
    past: History, pairs: np.ndarray, shift: np.ndarray, slot: np.ndarray, stiffness: np.ndarray, blocks: np.ndarray
) -> None:
    """Write stiffness and history of new pairs into blocks; pairs without history are set to 0.

    Contacts that pad a block have a stiffness of 1.

    Args:
        past: History of the contacts so far; `number` is the index in `past` of each grain of the new pairs.
        pairs: Grains of the new pairs, (2, n).
        shift: Periodic shifts of the new pairs, (n, 3).
        slot: Positions of the new pairs in the blocks, (n,).
        stiffness: kn of the new pairs, (n,), in N/m.
        blocks: Blocks to write to, (block, row, WIDTH).
    """
    n, grains, (m, rows) = len(shift), len(past.number), past.rows.shape
    if blocks.shape[1:] != (1 + rows, WIDTH) or blocks.dtype != past.rows.dtype:
        raise ValueError(f"blocks {blocks.shape} of {blocks.dtype} do not fit a history of {rows} rows")
    call(
        f"carry_history_{precision_of(blocks.dtype)}",
        *(as_indices(np.int32, past.pairs, grains, 2, m), as_array(np.int32, past.shift, m, 3)),
        *(np.ascontiguousarray(past.rows), m, rows, as_array(np.int8, past.odd, rows)),
        *(as_indices(np.int64, past.number, grains, grains), grains, as_indices(np.int32, pairs, grains, 2, n)),
        *(as_array(np.int32, shift, n, 3), as_indices(np.int64, slot, len(blocks) * WIDTH, n), n),
        *(as_array(float, stiffness, n), blocks, len(blocks)),
    )


def take_rows(blocks: np.ndarray, first: int, slot: np.ndarray) -> np.ndarray:
    """Return the values (n, k) at the places `slot` (n,) in the k rows of blocks that start at offset `first`."""
    slot = as_indices(np.int64, slot, len(blocks) * WIDTH, len(slot))
    values = np.empty((len(slot), (blocks.shape[1] - first) // WIDTH), blocks.dtype)
    name = f"take_rows_{precision_of(blocks.dtype)}"
    call(name, blocks, blocks.shape[1], first, slot, len(slot), values.shape[1], values)
    return values


def find_touching(
    pairs: np.ndarray, shift: np.ndarray, position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> np.ndarray:
    """Return the indices of the pairs of grains that overlap or touch.

    Args:
        pairs: Grains of each pair, (n, 2).
        shift: Periods of the second grain, (n, 3).
        position: Positions, (grain, 3), in m.
        radius: Radii, (grain,), in m.
        cell: Cell vectors as columns, (3, 3), in m.
    """
    n, grains = len(pairs), len(radius)
    touching = np.empty(n, np.int64)
    arrays = (
        as_indices(np.int64, pairs, grains, n, 2),
        as_array(np.int32, shift, n, 3),
        n,
        as_array(float, position, grains, 3),
    )
    count = call("find_touching", *arrays, as_array(float, radius, grains), as_array(float, cell, 3, 3), touching)
    return touching[:count].astype(np.intp, copy=False)
