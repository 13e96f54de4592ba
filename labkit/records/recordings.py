"""The records and snapshots of a run in memory, and how they are written to an open run file."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from labkit.files.netcdf import create_variables
from labkit.files.schema import CONTACTS, GRAINS, HISTORY, Variable
from labkit.grains.state import State
from labkit.micro.snapshot import Snapshot

if TYPE_CHECKING:
    import netCDF4

RECORD_BYTES = 1_000  # approximate size of a record


@dataclasses.dataclass
class Recordings:
    """Records (index -> values), and snapshots as pairs (index of the record, Snapshot)."""

    records: dict[int, dict[str, object]] = dataclasses.field(default_factory=dict)
    snapshots: list[tuple[int, Snapshot]] = dataclasses.field(default_factory=list)

    @property
    def bytes(self) -> int:
        """Approximate number of bytes in memory."""
        snapshots = sum(
            24 * len(snapshot.spheres.radius) + 120 * len(snapshot.contacts) for _, snapshot in self.snapshots
        )
        return snapshots + RECORD_BYTES * len(self.records)

    def extend(self, later: Recordings) -> None:
        """Add later records and snapshots; a record with the same index replaces the earlier one."""
        self.records |= later.records
        self.snapshots += later.snapshots

    def variables(self, table: Mapping[str, Variable]) -> Iterator[tuple[str, Variable, np.ndarray]]:
        """Yield (group of a run file, variable, values); `table` lists the variables of a record.

        Records are in the root group, "". The contacts of all snapshots follow one another.
        """
        for variable in table.values() if self.records else ():
            values = [record[variable.name] for record in self.records.values()]
            yield "", variable, np.array(values).astype(variable.dtype, copy=False)
        if not self.snapshots:
            return
        spheres = [snapshot.spheres for _, snapshot in self.snapshots]
        contacts = [part.contacts for part in spheres]
        yield "contacts", CONTACTS["record"], np.array([number for number, _ in self.snapshots], np.int32)
        yield "contacts", CONTACTS["row_size"], np.array([len(listed) for listed in contacts], np.int32)
        yield (
            "contacts",
            CONTACTS["contact_grain"],
            np.concatenate([listed.grain for listed in contacts], dtype=np.int32),
        )
        for name in ("normal", "overlap", "normal_force", "tangential_force", "rolling_moment"):
            yield "contacts", CONTACTS[name], np.concatenate([getattr(listed, name) for listed in contacts])
        for name in contacts[0].columns:
            yield "contacts", HISTORY[name], np.concatenate([listed.columns[name] for listed in contacts])
        yield "grains", GRAINS["position"], np.array([grains.position for grains in spheres])
        bodies = [snapshot.clumps for _, snapshot in self.snapshots]
        for name, row in bodies[0].of_run.items() if bodies[0] is not None else ():
            if "snapshot" in row.dimensions:
                yield "grains", row, np.stack([getattr(clumps, name) for clumps in bodies])


def table_of_grains(state: State) -> dict[str, Variable]:
    """Return the variables in the group `grains` of a run file, for the kind of grains in a State."""
    return GRAINS if state.bodies is None else GRAINS | state.bodies.of_run


def constants_of(state: State) -> dict[str, np.ndarray]:
    """Return the values of the variables in `table_of_grains` that do not change during a run."""
    rows, values = table_of_grains(state), state.arrays
    return {name: values[name] for name in rows if "snapshot" not in rows[name].dimensions}


def create_run(dataset: netCDF4.Dataset, table: Mapping[str, Variable], state: State) -> None:
    """Create the variables of a run file: those of `table` at each record, and the grains and contacts of a State."""
    create_variables(dataset, table, {}, compressed=False)
    dataset.createDimension("snapshot", None)
    create_variables(dataset.createGroup("contacts"), CONTACTS, {})
    create_variables(dataset.createGroup("grains"), table_of_grains(state), state.sizes)
    for name, values in constants_of(state).items():
        dataset["grains"][name][:] = values


def append_records(dataset: netCDF4.Dataset, table: Mapping[str, Variable], unsaved: Recordings) -> None:
    """Append records, with the variables of `table`, and snapshots to an open run file."""
    snapshots, contacts = (
        len(dimension) for dimension in (dataset.dimensions["snapshot"], dataset["contacts"].dimensions["contact"])
    )
    starts = {"time": min(unsaved.records, default=0), "snapshot": snapshots, "contact": contacts}
    for name, variable, values in unsaved.variables(table):
        group, start = dataset[name] if name else dataset, starts[variable.dimensions[0]]
        if variable.name not in group.variables:  # further history of contacts, which most laws lack
            create_variables(group, {variable.name: variable}, {})
        group[variable.name][start : start + len(values)] = values
