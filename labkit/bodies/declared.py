"""How a kind of bodies declares its variables: those of a State, of its files, and of what an engine moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Container
from typing import TYPE_CHECKING, Any, TypeVar

from labkit.io.schema import BODIES, Variable, kind_of_bodies

if TYPE_CHECKING:
    from labkit.bodies.clumps import Clumps

Kind = TypeVar("Kind", bound="Clumps")

KINDS: dict[str, type[Clumps]] = {}  # by the variable that tells the kind


def variable(
    dimensions: str, units: str, long_name: str, dtype: str = "f8", *, moves: bool = False, in_runs: bool = True
) -> Any:
    """Return a dataclass field that is a variable of bodies.

    Args:
        dimensions: Its dimensions, separated by spaces: first `grain`, the spheres, or `clump`, the bodies.
        units: Unit, as files have it.
        long_name: What it is, as files have it.
        dtype: Its type in files.
        moves: True if an engine changes it.
        in_runs: False if snapshots of runs lack it: a velocity or a momentum, 0 for bodies at rest.
    """
    row = Variable("", tuple(dimensions.split()), dtype, units, long_name)
    return dataclasses.field(metadata={"variable": row, "moves": moves, "in_runs": in_runs})


def declare(kind: type[Kind]) -> type[Kind]:
    """Tell files and engines about the variables of a dataclass; a decorator.

    The first variable that no other kind has tells the kind in files. Raises ValueError if there is none.
    """
    fields = {field.name: field.metadata for field in dataclasses.fields(kind)}
    kind.table = {name: dataclasses.replace(of["variable"], name=name) for name, of in fields.items()}
    kind.motion = tuple(name for name, of in fields.items() if of["moves"])
    kind.of_run = {
        name: dataclasses.replace(row, dimensions=("snapshot", *row.dimensions)) if name in kind.motion else row
        for name, row in kind.table.items()
        if fields[name]["in_runs"]
    }
    known = {name for table, _ in BODIES.values() for name in table}
    telling = next((name for name in kind.table if name not in known), None)
    if telling is None:
        raise ValueError(f"{kind.__name__} has no variable of its own, which would tell it in a file")
    BODIES[telling], KINDS[telling] = (kind.table, kind.of_run), kind
    return kind


def kind_in(names: Container[object]) -> type[Clumps] | None:
    """Return the kind of the bodies in a file with variables of these names, or None for single grains."""
    telling = kind_of_bodies(names)
    return None if telling is None else KINDS[telling]
