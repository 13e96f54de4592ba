"""The look-up of a quantity by name, and user-defined statistics, which enter the same table.

A statistic is a function of a Snapshot that a run records in addition to the variables of labkit.files.schema.

    @labkit.register_statistic("sliding_fraction", long_name="fraction of contacts at the friction limit")
    def sliding_fraction(snapshot): ...

The command line, campaigns, `verify` and figures use the metadata given in the decorator. Files that lack the statistic
can still be read.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from labkit.errors import InputError, nearest
from labkit.extensions import Registry, require_function
from labkit.files.schema import BY_VOLUME, ECCENTRICITY, RECORD, SIZES, Variable
from labkit.micro.snapshot import Snapshot
from labkit.quantities.scalars import ALIASES, QUANTITIES, Quantity


@dataclasses.dataclass(frozen=True)
class Statistic:
    """A statistic that every record contains; `dimensions` are keys of labkit.files.schema.SIZES, without `time`."""

    name: str
    dimensions: tuple[str, ...]
    units: str
    long_name: str
    function: Callable[[Snapshot], object]

    @property
    def variable(self) -> Variable:
        """Return the netCDF variable that stores the statistic in a run file."""
        return Variable(self.name, ("time", *self.dimensions), "f8", self.units, self.long_name)

    def __call__(self, snapshot: Snapshot) -> np.ndarray:
        """Compute the value for a Snapshot. Raises InputError if its shape does not match `dimensions`."""
        result = self.function(snapshot)
        shape = tuple(SIZES[dimension] for dimension in self.dimensions)
        value = None if result is None else np.asarray(result, dtype=float)
        if value is None or value.shape != shape:
            returned = "nothing" if value is None else f"an array of shape {value.shape}"
            registered = "one number" if not shape else f"an array of shape {shape}"
            raise InputError(
                f"statistic {self.name} returned {returned} but was registered as {registered}: return that, or change "
                'its dimensions, e.g. dimensions=("i", "j")'
            )
        return value


STATISTICS = Registry[Statistic]("statistic", {})


def register_statistic(
    name: str, *, long_name: str = "", units: str = "1", dimensions: tuple[str, ...] = ()
) -> Callable[[Callable[[Snapshot], object]], Statistic]:
    """Return a decorator that registers a function of a Snapshot, so that runs record its value.

    `long_name` labels figures (default: the name). A tensor has `dimensions=("i", "j")`, a vector `("i",)`.
    Raises InputError for a name that is taken, or dimensions other than i, j and side.
    """
    unknown = set(dimensions) - set(SIZES)
    if unknown or isinstance(dimensions, str) or len(set(dimensions)) < len(dimensions):
        allowed = 'a tuple of distinct names from "i", "j", "side"'
        raise InputError("are not dimensions of a record", field="dimensions", value=dimensions, allowed=allowed)
    if name in {*RECORD, *QUANTITIES, *ALIASES}:
        raise InputError("is already the name of a quantity", field="name", value=name, allowed="another name")

    def register(function: Callable[[Snapshot], object]) -> Statistic:
        require_function(function)
        statistic = Statistic(name, tuple(dimensions), units, long_name or name.replace("_", " "), function)
        STATISTICS.register(statistic)
        return statistic

    return register


def recorded_statistics() -> tuple[Statistic, ...]:
    """Return the registered statistics, which runs record in addition to labkit.files.schema.RECORD."""
    return tuple(STATISTICS.values())


def record_table() -> dict[str, Variable]:
    """Return all variables of a record, name -> Variable, including the registered statistics."""
    return {**RECORD, **{statistic.name: statistic.variable for statistic in recorded_statistics()}}


def quantity(name: str) -> Quantity:
    """Return a Quantity by name: one of QUANTITIES, a recorded scalar, or a component such as `stress_xz` or `A_zz`.

    Raises InputError for an unknown name.
    """
    name = ALIASES.get(name, name) if name not in ("sigma", "eps") else name
    if name in QUANTITIES:
        return QUANTITIES[name]
    base, _, axes = name.rpartition("_")
    for variable, component in ((name, ""), (ALIASES.get(base, base), axes)):
        row = _recorded_quantity(variable, component)
        if row is not None:
            return row
    raise InputError("is unknown", field="quantity", value=name, allowed=_suggestion(name), quoted=True)


def _recorded_quantity(variable: str, axes: str) -> Quantity | None:
    """Return a recorded scalar, or the component `axes` (e.g. xz) of a recorded vector or tensor, or None."""
    row = (record_table() | BY_VOLUME | ECCENTRICITY).get(variable)
    if row is None or len(row.dimensions) != 1 + len(axes) or not set(axes) <= set("xyz"):
        return None
    place = (..., *("xyz".index(axis) for axis in axes))
    name = f"{variable}_{axes}" if axes else variable
    return Quantity(
        name,
        row.units,
        f"{row.long_name}, {axes}" if axes else row.long_name,
        lambda record, _: record[variable][place],
        (variable,),
    )


def _suggestion(name: str) -> str:
    """List the names that can replace an unknown name."""
    scalars = [v.name for v in record_table().values() if len(v.dimensions) == 1]
    every = [*QUANTITIES, *(alias for alias in ALIASES if alias not in ("A", "F", "Ft", "sigma", "eps")), *scalars]
    close = nearest(name, every)
    start = "one of" if close is None else f"{close!r}, or another of"
    return f"{start} {', '.join(QUANTITIES)}, a recorded variable such as void_ratio, or a component such as stress_xz"
