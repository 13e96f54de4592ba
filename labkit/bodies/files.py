"""The bodies in state and run files."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from typing import Any

import netCDF4
import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.bodies.declared import kind_in
from labkit.io.hashes import values_of
from labkit.io.schema import SIZES, Variable


def read_bodies(group: netCDF4.Dataset) -> Clumps | None:
    """Read the bodies of a State from its group, or None. Raises ValueError if they are invalid."""
    kind = kind_in(group.variables)
    return None if kind is None else _valid(kind(**{name: values_of(group[name]) for name in kind.table}))


def read_bodies_at(grains: netCDF4.Group, number: int) -> Clumps | None:
    """Read the bodies at a snapshot of a run file from its group `grains`; see `bodies_in_run`."""

    def read(name: str) -> np.ndarray:
        return values_of(grains[name], number if "snapshot" in grains[name].dimensions else ...)

    return bodies_in_run(grains.variables, read)


def bodies_in_run(names: Container[object], read: Callable[[str], np.ndarray]) -> Clumps | None:
    """Read the bodies at one snapshot of a run file, at rest, or None.

    Raises ValueError if they are invalid.

    Args:
        names: Names of the variables in its group `grains`.
        read: Returns the values of a variable at the snapshot.
    """
    kind = kind_in(names)
    if kind is None:
        return None
    values = {name: read(name).astype(row.dtype) for name, row in kind.of_run.items()}
    sizes = dict(SIZES)
    for name, array in values.items():
        sizes |= zip(kind.table[name].dimensions, array.shape, strict=True)
    zero = {name: np.zeros([sizes[one] for one in row.dimensions]) for name, row in kind.table.items()}
    return _valid(kind(**(zero | values)))


def _valid(bodies: Clumps) -> Clumps:
    bodies.require_valid()
    return bodies


def rows_of_run(bodies: Clumps | None) -> dict[str, Variable]:
    """The variables of bodies in the group `grains` of a run file."""
    return {} if bodies is None else bodies.of_run


def constants_of_run(bodies: Clumps | None) -> dict[str, np.ndarray]:
    """The values of those variables that are the same in all snapshots."""
    return {
        name: getattr(bodies, name) for name, row in rows_of_run(bodies).items() if "snapshot" not in row.dimensions
    }


def snapshots_of_run(bodies: Sequence[Clumps | None]) -> Iterator[tuple[Variable, np.ndarray]]:
    """Yield the other variables with their values in some snapshots."""
    for name, row in rows_of_run(bodies[0]).items():
        if "snapshot" in row.dimensions:
            yield row, np.stack([getattr(one, name) for one in bodies])


def number_of_bodies(sizes: Mapping[Any, int]) -> int:
    """Number of bodies, or of grains that are bodies of their own, from the dimensions of a file; 0 if it has none."""
    return sizes.get("clump", sizes.get("grain", 0))
