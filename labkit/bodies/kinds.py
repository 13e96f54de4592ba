"""Kinds of bodies: how a kind declares its variables, and how bodies are read from files.

Each variable of a body is a field, declared by one of three functions. The arguments of these functions are the
variable's dimensions in files, unit, long name and, unless it is a double, type. The first dimension is `grain` (one
value per sphere) or `clump` (one value per body).

constant  never changes
place     changed by an engine, and stored in each snapshot of a run
motion    changed by an engine; a vector that is zero at rest and not stored in snapshots of a run
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from labkit.files.hashes import values_of
from labkit.files.schema import BODIES, Spheres, Variable, kind_of_bodies
from labkit.parameters import Field

if TYPE_CHECKING:
    import netCDF4

    from labkit.bodies.clumps import Clumps

Kind = TypeVar("Kind", bound="Clumps")


def _variable(role: str, dimensions: str, units: str, long_name: str, dtype: str = "f8") -> Field:
    row = Variable("", tuple(dimensions.split()), dtype, units, long_name)
    return dataclasses.field(metadata={"role": role, "row": row})


constant, place, motion = (functools.partial(_variable, role) for role in ("constant", "place", "motion"))


def declare(kind: type[Kind]) -> type[Kind]:
    """Declare the variables of a dataclass to files and engines; use it as a class decorator.

    A file of this kind is recognised by the first variable of the kind that no other kind declares. Raises ValueError
    if there is no such variable.
    """
    taken = {name for other in BODIES.values() for name in other.table}
    kind.table, kind.of_run, kind.moving = {}, {}, ()
    for field in dataclasses.fields(kind):
        row, role = dataclasses.replace(field.metadata["row"], name=field.name), field.metadata["role"]
        kind.table[field.name] = row
        kind.moving += (field.name,) * (role != "constant")
        if role != "motion":
            dimensions = ("snapshot",) * (role == "place") + row.dimensions
            kind.of_run[field.name] = dataclasses.replace(row, dimensions=dimensions)
    free = [name for name in kind.table if name not in taken]
    if not free:
        raise ValueError(f"{kind.__name__} has no variable of its own, by which its files would be recognised")
    BODIES[free[0]] = kind
    return kind


def read_bodies(group: netCDF4.Dataset) -> Clumps | None:
    """Return the bodies in the group of a State, or None without bodies. Raises ValueError if they are invalid."""
    kind = kind_of_bodies(group.variables)
    return None if kind is Spheres else kind(**{name: values_of(group[name]) for name in kind.table}).validate()


def bodies_in_run(values: Mapping[Hashable, object]) -> Clumps | None:
    """Return the bodies, at rest, in one snapshot of a run, or None if the snapshot has none.

    `values` are the variables of the group `grains` at that snapshot. Raises ValueError if the bodies are invalid.
    """
    kind = kind_of_bodies(values)
    if kind is Spheres:
        return None
    columns = {name: np.asarray(values[name]).astype(row.dtype) for name, row in kind.of_run.items()}
    return kind(**(dict.fromkeys(kind.table, columns["body_position"]) | columns)).at_rest().validate()
