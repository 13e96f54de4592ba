"""Stores a run without a file in memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from labkit.files.hashes import NOTE, sha256_of_groups
from labkit.files.schema import CONTACTS, SIZES, Variable
from labkit.grains.state import State
from labkit.records.recorder import Recordings, constants_of, table_of_grains

Groups = dict[str, dict[str, tuple[Variable, np.ndarray]]]  # variables and values by group ("" for the root) and name


@dataclasses.dataclass
class RunInMemory:
    """The records of a run without a file, up to its last checkpoint.

    `state` is the State of this checkpoint, None before the first checkpoint. `table` and `attributes` are the record
    table and the attributes that a file of this run would have.
    """

    recordings: Recordings = dataclasses.field(default_factory=Recordings)
    state: State | None = None
    table: Mapping[str, Variable] = dataclasses.field(default_factory=dict)
    attributes: dict[str, object] = dataclasses.field(default_factory=dict)

    def contents(self) -> tuple[dict[str, object], Groups]:
        """Return the attributes, including hashes, and the variables that a file of this run would have."""
        assert self.state is not None
        sizes = SIZES | self.state.sizes | {"time": 0, "snapshot": 0, "contact": 0}
        of_grains = table_of_grains(self.state)
        groups: Groups = {
            group: {
                name: (row, np.zeros([sizes[dimension] for dimension in row.dimensions], row.dtype))
                for name, row in rows.items()
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
