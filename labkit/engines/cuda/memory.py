"""Device memory needed by a batch, estimated before allocation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from labkit.engines.cuda.arrays import ENERGIES, GRID_CELLS, HISTORY
from labkit.engines.cuda.device import BLOCK, cuda
from labkit.errors import InputError

# Entries of neighbour lists per grain, including those that fill up slices, for 2.9 contacts and 7.0 neighbours per
# grain: counted in 1,000 grains of the paper's grading at e = 0.60 and 0.5 MPa
ENTRIES = 10.2
SPARE = 1.25  # over-allocation of entries when a search does not fit

KINDS: dict[str, type[np.floating]] = {"double": np.float64, "mixed": np.float32}  # of numbers that may be single

INDEX, SHIFT, DOUBLE = 4, 2, 8  # bytes of a number
OF_GRAIN = 2 * INDEX + (3 + 6 * 3 + ENERGIES) * DOUBLE  # arrays.Grains
OF_LISTS = 2 * INDEX  # arrays.Lists, without entries
OF_GRID = (2 + 3 + 2 * GRID_CELLS) * INDEX  # arrays.Grid
USABLE, CONTEXT = 0.9, 0.5e9  # usable share of the device's memory; bytes of it that CUDA needs


def memory_of(grains: int, precision: str = "double") -> float:
    """Memory that a State needs, bytes: about 2.2 kB per grain, 1.5 kB in mixed precision."""
    of_entry = INDEX + 3 * SHIFT + (1 + HISTORY) * np.dtype(KINDS[precision]).itemsize
    return (grains + BLOCK) * (OF_GRAIN + OF_LISTS + OF_GRID + 2.0 * SPARE * ENTRIES * of_entry)


def room() -> float:
    """Memory available to the States of a batch on this device, bytes."""
    return USABLE * float(cuda.current_context().get_memory_info().total) - CONTEXT


def require_room(grains: Sequence[int], precision: str) -> None:
    """Raise InputError if States with these numbers of grains do not fit into the free memory."""
    needed, free = sum(memory_of(n, precision) for n in grains), float(cuda.current_context().get_memory_info().free)
    if needed > free:
        smaller = "fewer grains" if precision == "mixed" else "fewer grains, precision mixed"
        raise InputError(
            f"{sum(grains):,} grains need about {needed / 1e9:.1f} GB of the GPU's memory, of which {free / 1e9:.1f} "
            f"GB are free: give {smaller} or the engine fused"
        )
