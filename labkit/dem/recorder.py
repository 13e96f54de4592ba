"""The recorder: appends records, snapshots and a checkpoint to a run file that is whole at any moment.

What was recorded since the last save is kept in memory. A save copies the file, appends to the copy
and puts it in place of the old one, so that a kill at any moment leaves the last save under the name.
The checkpoint, a State in the group `checkpoint`, comes with the records that belong to it.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from labkit.dem.laws import LAWS
from labkit.dem.paths import Path as LoadingPath
from labkit.dem.recorded import record_table
from labkit.dem.state import State, read_group, write_attributes
from labkit.errors import InputError, PhysicsError
from labkit.io.files import create_variables, open_netcdf, remove_leftovers, whole_file
from labkit.io.interruption import only_writer
from labkit.io.provenance import data_sha256
from labkit.io.schema import CONTACTS, GRAINS, STATE
from labkit.micro.snapshot import Snapshot


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a run stands on its path: reversals on stress so far, and the equivalent lattice of the first cell."""

    leg: int = 0
    lattice: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))  # see labkit.dem.lattice


@dataclasses.dataclass(frozen=True)
class Begun:
    """A run to go on with: the State of its checkpoint, the seconds spent, whether it is complete."""

    state: State
    first_cell: np.ndarray  # (3, 3), m: at zero strain
    wall_time: float
    complete: bool
    place: Place


class Recorder:
    """Writes one run file, alone while it is open as a context.

    `path` is the loading path, `settings` what else decides the records, `specimen` the State it starts from.
    """

    def __init__(
        self, file: os.PathLike[str] | str, path: LoadingPath, settings: dict[str, Any], specimen: State
    ) -> None:
        """Touches no file yet: `with` takes its lock."""
        self.table = record_table()
        self.file = Path(file)
        self.specimen = specimen.digest()
        self.earlier = [specimen.digest(law) for law in LAWS.earlier(specimen.scene.law)]  # of files of version 0.1.0
        self.path = path
        self.settings = settings
        self.records = 0  # in the file and in memory
        self._new = []
        self._snapshots = []

    def __enter__(self) -> Recorder:
        self._lock = only_writer(self.file)
        self._lock.__enter__()
        remove_leftovers(self.file)
        return self

    def __exit__(self, *exception: Any) -> None:
        self._lock.__exit__(*exception)

    def record(self, values: dict, snapshot: Snapshot | None = None) -> None:
        """Keeps one record (labkit.dem.measure), with the snapshot if it is given."""
        if snapshot is not None:
            self._snapshots.append((self.records, snapshot.contacts, snapshot.position))
        self._new.append(values)
        self.records += 1

    def save(self, state: State, complete: bool, wall_time: float, threads: int = 1, place: Place = Place()) -> None:  # noqa: B008
        """Brings the file up to the present: all records so far and the state to go on from."""
        try:
            self._save(state, complete, wall_time, threads, place)
        except (OSError, RuntimeError) as error:  # netCDF4 says RuntimeError when the disk is full
            raise PhysicsError(
                f"{self.file} could not be saved ({getattr(error, 'strerror', None) or error}); what was saved before "
                "is intact: make room on the disk and give the same command again"
            ) from None
        self._new.clear()
        self._snapshots.clear()

    def _save(self, state: State, complete: bool, wall_time: float, threads: int, place: Place) -> None:
        with whole_file(self.file) as temporary:
            exists = self.file.exists()
            if exists:
                shutil.copyfile(self.file, temporary)
            with netCDF4.Dataset(temporary, "a" if exists else "w") as dataset:
                if not exists:
                    self._create(dataset, state)
                self._append(dataset)
                write_attributes(dataset, state, "run")
                dataset.complete = np.int32(complete)
                dataset.wall_time = float(wall_time)
                dataset.steps = np.int64(state.step)
                dataset.threads = np.int32(threads)
                _write_checkpoint(dataset, state)
                dataset["checkpoint"].leg = np.int64(place.leg)
                dataset["checkpoint"].lattice = place.lattice.ravel()
                if complete:
                    dataset.data_sha256 = data_sha256(dataset)

    def _create(self, dataset: netCDF4.Dataset, state: State) -> None:
        dataset.setncattr("path", self.path.name)  # `dataset.path` is netCDF4's own
        dataset.path_parameters = self.parameters()
        dataset.specimen = self.specimen
        create_variables(dataset, self.table, {}, compression=None)
        dataset.createDimension("snapshot", None)
        create_variables(dataset.createGroup("contacts"), CONTACTS, {})
        dataset["contacts"]["row_size"].sample_dimension = "contact"
        create_variables(dataset.createGroup("grains"), GRAINS, {"grain": state.number_of_grains})
        dataset["grains"]["radius"][:] = state.radius

    def parameters(self) -> str:
        """The parameters of the path and the settings as JSON: the attribute `path_parameters`."""
        return json.dumps({**self.path.parameters(), **self.settings})

    def _append(self, dataset: netCDF4.Dataset) -> None:
        first = len(dataset.dimensions["time"])
        for name in self.table:
            values = [record[name] for record in self._new]
            if values:
                dataset[name][first : first + len(values)] = np.array(values)
        group, positions = dataset["contacts"], dataset["grains"]["position"]
        for index, contacts, position in self._snapshots:
            snapshot = len(dataset.dimensions["snapshot"])
            start = len(group.dimensions["contact"])
            group["record"][snapshot] = index
            group["row_size"][snapshot] = len(contacts)
            group["contact_grain"][start : start + len(contacts)] = contacts.grain
            for name in ("normal", "overlap", "normal_force", "tangential_force", "rolling_moment"):
                group[name][start : start + len(contacts)] = getattr(contacts, name)
            positions[snapshot] = position

    def _require_same_variables(self, dataset: netCDF4.Dataset) -> None:
        """Raises InputError unless an unfinished run holds the variables that are recorded now."""
        found = {name for name, variable in dataset.variables.items() if variable.dimensions[:1] == ("time",)}
        for what, names in (("lacks", set(self.table) - found), ("has", found - set(self.table))):
            if names:
                raise InputError(
                    f"{self.file} was begun with other recorded statistics, it {what} {', '.join(sorted(names))}: "
                    "choose another file, or the same extensions to go on with it"
                )

    def resume(self) -> Begun | None:
        """What a Begun run file holds, or None when there is no file yet.

        Raises InputError when the file holds a run with other parameters or of another specimen.
        """
        if not self.file.exists():
            return None
        with open_netcdf(self.file, "run") as dataset:
            found = dataset.getncattr("path"), dataset.path_parameters
            if (found[0], json.loads(found[1])) != (self.path.name, json.loads(self.parameters())):
                raise InputError(
                    f"{self.file} holds another run ({_difference(found, (self.path.name, self.parameters()))}): "
                    "choose another file, or the same options to go on with it"
                )
            if not bool(dataset.complete):
                self._require_same_variables(dataset)
            if getattr(dataset, "specimen", None) not in (self.specimen, *self.earlier):
                raise InputError(f"{self.file} was begun with another specimen: choose another file")
            self.records = len(dataset.dimensions["time"])
            checkpoint, first_cell = dataset["checkpoint"], dataset["cell"][0].filled()
            lattice = np.reshape(getattr(checkpoint, "lattice", np.eye(3)), (3, 3))  # version 0.1.0 has none
            place = Place(int(getattr(checkpoint, "leg", 0)), lattice)
            state = _read_checkpoint(dataset)
            return Begun(state, first_cell, float(dataset.wall_time), bool(dataset.complete), place)


def read_checkpoint(file: os.PathLike[str] | str) -> State:
    """The State of the last save of a run file. Raises InputError when it is none."""
    with open_netcdf(file, "run") as dataset:
        return _read_checkpoint(dataset)


def _read_checkpoint(dataset: netCDF4.Dataset) -> State:
    group = dataset["checkpoint"]
    return read_group(group, dataset, int(group.contacts))


def _write_checkpoint(dataset: netCDF4.Dataset, state: State) -> None:
    """Overwrites the last checkpoint. Not compressed: HDF5 can then write every value where the old one was."""
    contacts = len(state.contact_grain)
    if "checkpoint" not in dataset.groups:
        group = dataset.createGroup("checkpoint")
        create_variables(group, STATE, {"grain": state.number_of_grains}, compression=None)
    group = dataset["checkpoint"]
    group.contacts = np.int64(contacts)
    for name, variable in STATE.items():
        rows = slice(contacts) if "contact" in variable.dimensions else slice(None)
        group[name][rows] = getattr(state, name)


def _difference(found: tuple[str, str], wanted: tuple[str, str]) -> str:
    """What tells two runs apart: the path, or the settings that differ."""
    if found[0] != wanted[0]:
        return f"path {found[0]}, not {wanted[0]}"
    before, now = (json.loads(text) for text in (found[1], wanted[1]))
    names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    return ", ".join(f"{name} {before.get(name)}, not {now.get(name)}" for name in names)
