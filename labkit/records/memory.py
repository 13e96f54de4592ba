"""Records and snapshots in memory: all those of a run without a file, or those that its file lacks so far."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from labkit.grains.state import State
from labkit.io.hashes import NOTE, sha256_of_groups
from labkit.io.links import PARTS
from labkit.io.schema import CLUMPS_OF_RUN, CONTACTS, GRAINS, LINKS, PER_SNAPSHOT, SIZES, Variable
from labkit.micro.snapshot import Snapshot

RECORD_BYTES = 1_000  # approximate size of one record

Groups = dict[str, dict[str, tuple[Variable, np.ndarray]]]  # by group, "" for the root, and name: variables and values


@dataclasses.dataclass
class Recordings:
    """Records, number -> values, and snapshots, (number of the record, snapshot)."""

    records: dict[int, dict[str, object]] = dataclasses.field(default_factory=dict)
    snapshots: list[tuple[int, Snapshot]] = dataclasses.field(default_factory=list)

    @property
    def bytes(self) -> int:
        """Approximate number of bytes in memory."""
        snapshots = sum(24 * len(one.spheres.radius) + 120 * len(one.contacts) for _, one in self.snapshots)
        return snapshots + RECORD_BYTES * len(self.records)

    def extend(self, later: Recordings) -> None:
        """Add later records and snapshots; a record with the same number replaces the earlier one."""
        self.records |= later.records
        self.snapshots += later.snapshots

    def variables(self, table: Mapping[str, Variable]) -> Iterator[tuple[str, Variable, np.ndarray]]:
        """Yield (group of a run file, variable, its values), with the variables of a `table` of records.

        The group of the records, the root, is "". The contacts of all snapshots follow one another.
        """
        for variable in table.values() if self.records else ():
            values = [record[variable.name] for record in self.records.values()]
            yield "", variable, np.array(values).astype(variable.dtype, copy=False)
        if not self.snapshots:
            return
        spheres = [one.spheres for _, one in self.snapshots]
        contacts = [one.contacts for one in spheres]
        yield "contacts", CONTACTS["record"], np.array([number for number, _ in self.snapshots], np.int32)
        yield "contacts", CONTACTS["row_size"], np.array([len(one) for one in contacts], np.int32)
        yield "contacts", CONTACTS["contact_grain"], np.concatenate([one.grain for one in contacts], dtype=np.int32)
        for name in ("normal", "overlap", "normal_force", "tangential_force", "rolling_moment"):
            yield "contacts", CONTACTS[name], np.concatenate([getattr(one, name) for one in contacts])
        links = [one.links for one in contacts if one.links is not None]
        for name, part in PARTS.items() if links else ():
            yield "contacts", LINKS[name], np.concatenate([one[:, part] for one in links])
        yield "grains", GRAINS["position"], np.array([one.position for one in spheres])
        for name in PER_SNAPSHOT if self.snapshots[0][1].clumps is not None else ():
            yield "grains", CLUMPS_OF_RUN[name], np.stack([getattr(one.clumps, name) for _, one in self.snapshots])


def table_of_grains(state: State) -> dict[str, Variable]:
    """The variables of the group `grains` of a run file, for grains like those of a State."""
    spheres = state.clumps is None or state.clumps.single.all()
    return GRAINS if spheres else GRAINS | CLUMPS_OF_RUN


def constants_of(state: State) -> dict[str, np.ndarray]:
    """The values of these variables that are the same at all times."""
    names = table_of_grains(state).keys() - GRAINS.keys() - set(PER_SNAPSHOT)
    return {"radius": state.radius, **{name: getattr(state.clumps, name) for name in names}}


@dataclasses.dataclass
class RunInMemory:
    """What a run without a file has recorded up to its last checkpoint, whose State is `state` (None before the first).

    `table` and `attributes` are those that its file would have.
    """

    recordings: Recordings = dataclasses.field(default_factory=Recordings)
    state: State | None = None
    table: Mapping[str, Variable] = dataclasses.field(default_factory=dict)
    attributes: dict[str, Any] = dataclasses.field(default_factory=dict)

    def contents(self) -> tuple[dict[str, Any], Groups]:
        """Return the attributes of the file that the run would have, with its hashes, and its variables."""
        assert self.state is not None
        sizes = SIZES | self.state.sizes | {"time": 0, "snapshot": 0, "contact": 0}
        of_grains = table_of_grains(self.state)
        groups: Groups = {
            group: {
                name: (row, np.zeros([sizes[one] for one in row.dimensions], row.dtype)) for name, row in rows.items()
            }
            for group, rows in (("", self.table), ("contacts", CONTACTS), ("grains", of_grains))
        }
        groups["grains"] |= {
            name: (of_grains[name], values.copy()) for name, values in constants_of(self.state).items()
        }
        for group, variable, values in self.recordings.variables(self.table):
            groups[group][variable.name] = variable, values
        arrays = (("/" + group, {name: values for name, (_, values) in of.items()}) for group, of in groups.items())
        hashes = {"data_sha256": sha256_of_groups(arrays)} if self.attributes["complete"] else {}
        return {**self.attributes, "seal": NOTE, **hashes}, groups
