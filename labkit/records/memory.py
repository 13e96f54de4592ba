"""Stores a run without a file in memory."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping

import numpy as np

from labkit.files.hashes import sha256_of_groups
from labkit.files.netcdf import new_netcdf
from labkit.files.schema import CONTACTS, SIZES, Variable
from labkit.grains.state import State
from labkit.records.checkpoint import Checkpoint, write_checkpoint
from labkit.records.recorder import MARGIN
from labkit.records.recordings import Recordings, append_records, constants_of, create_run, table_of_grains

Groups = dict[str, dict[str, tuple[Variable, np.ndarray]]]  # variables and values by group ("" for the root) and name


@dataclasses.dataclass
class RunInMemory:
    """The records of a run without a file, up to its last checkpoint.

    `point` is this Checkpoint, None before the first one. `table` and `attributes` are the record table and the
    attributes that a file of this run would have.
    """

    recordings: Recordings = dataclasses.field(default_factory=Recordings)
    point: Checkpoint | None = None
    table: Mapping[str, Variable] = dataclasses.field(default_factory=dict)
    attributes: dict[str, object] = dataclasses.field(default_factory=dict)

    @property
    def state(self) -> State | None:
        """The State of the last checkpoint."""
        return None if self.point is None else self.point.state

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the run file of a run that has begun. Raises OSError."""
        assert self.point is not None
        with new_netcdf(path, MARGIN + self.recordings.bytes + self.point.state.nbytes) as dataset:
            create_run(dataset, self.table, self.point.state)
            append_records(dataset, self.table, self.recordings)
            dataset.setncatts(self.attributes)
            write_checkpoint(dataset, self.point)

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
        return {**self.attributes, **hashes}, groups
