"""Recorded statistics: functions of a Snapshot that every record of a run holds beside those of labkit.io.schema.

    @labkit.register_statistic("sliding_fraction", long_name="share of contacts at the friction limit")
    def sliding_fraction(snapshot): ...

Command line, campaigns, `verify` and figures know it by what it says of itself; a file without it is read as well.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from labkit.errors import InputError
from labkit.extensions import Registry
from labkit.io.schema import RECORD, SIZES, Variable
from labkit.micro.snapshot import Snapshot


@dataclasses.dataclass(frozen=True)
class Statistic:
    """A number or tensor of each record. dimensions: those beyond `time`, of labkit.io.schema.SIZES."""

    name: str
    dimensions: tuple[str, ...]
    units: str
    long_name: str
    function: Callable[[Snapshot], Any]

    @property
    def variable(self) -> Variable:
        """How it stands in a run file."""
        return Variable(self.name, ("time", *self.dimensions), "f8", self.units, self.long_name)

    def __call__(self, snapshot: Snapshot) -> np.ndarray:
        """Its value for a Snapshot, of the shape that it says. Raises InputError for another shape."""
        made = self.function(snapshot)
        shape = tuple(SIZES[dimension] for dimension in self.dimensions)
        value = np.full(shape, np.nan) if made is None else np.asarray(made, dtype=float)
        if made is None or value.shape != shape:
            what = "nothing" if made is None else f"the shape {value.shape}"
            said = "one number" if not shape else f"the shape {shape}"
            raise InputError(
                f"statistic {self.name} returned {what}, and was registered as {said}: return that, or give other "
                'dimensions, e.g. dimensions=("i", "j")'
            )
        return value


STATISTICS: Registry = Registry("statistic", {})


def register_statistic(
    name: str, *, long_name: str, units: str = "1", dimensions: tuple[str, ...] = ()
) -> Callable[[Callable[[Snapshot], Any]], Statistic]:
    """A decorator for a function of a Snapshot, which is recorded from then on. Raises InputError for a name that is
    taken, or dimensions that are not i, j or side.
    """
    unknown = set(dimensions) - set(SIZES)
    if unknown or isinstance(dimensions, str) or len(set(dimensions)) < len(dimensions):
        allowed = 'a tuple of different ones of "i", "j", "side"'
        raise InputError("are not dimensions of a record", field="dimensions", value=dimensions, allowed=allowed)
    if name in RECORD:
        raise InputError("is recorded already", field="name", value=name, allowed="another name")

    def register(function: Callable[[Snapshot], Any]) -> Statistic:
        statistic = Statistic(name, tuple(dimensions), units, long_name, function)
        STATISTICS.register(statistic)
        return statistic

    return register


def recorded() -> tuple[Statistic, ...]:
    """The statistics that are recorded now beside those of labkit.io.schema.RECORD."""
    return tuple(STATISTICS.values())


def record_table() -> dict[str, Variable]:
    """The variables of a record, name -> Variable: those of labkit and the registered ones."""
    return {**RECORD, **{statistic.name: statistic.variable for statistic in recorded()}}
