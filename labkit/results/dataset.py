"""Run and state files as lazy xarray objects. Importing this module registers the accessor `.lab`."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, BinaryIO, cast

import numpy as np
import xarray as xr
from xarray.backends import CachingFileManager, NetCDF4DataStore

from labkit.errors import InputError, require_file_name, require_type
from labkit.files.library import LIBRARY
from labkit.files.netcdf import labkit_kind, name_damage, open_netcdf, storage
from labkit.files.opening import dataset_at
from labkit.files.schema import EPOCH, RECORD
from labkit.files.writable import stem
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.state_file import ATTRIBUTES, read_state
from labkit.micro.snapshot import Snapshot
from labkit.records.memory import RunInMemory
from labkit.results.accessor import Lab
from labkit.results.tables import with_axes


def open_run(path: str | os.PathLike) -> xr.Dataset:
    """Open a run file as one lazy xarray.Dataset.

    Dimensions: `time` (records; coordinates `axial_strain`, `time`), `snapshot` (records with contacts), `contact`
    (ragged: `row_size` contacts per snapshot), `grain`, `side`, and `i`, `j` with the labels x, y, z: the axial stress
    is `run["stress"].sel(i="z", j="z")`. The variables of the groups `contacts` and `grains` keep their names and
    units. For a table of the records use `run.lab.to_dataframe()`: `run.to_dataframe()` would combine every record with
    every contact and every grain. Raises InputError if `path` is not a valid run file.
    """
    require_file_name(path, "labkit.open_run('r.run.nc')")
    with open_netcdf(path, "run") as dataset:
        try:
            Scene.from_json(dataset.scene)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    with LIBRARY, name_damage(path):
        file = _file(path)
        run = _join(
            [xr.open_dataset(_store(file, group), decode_times=False) for group in (None, "contacts", "grains")]
        )
    run.encoding["source"] = str(path)
    run.set_close(file.close)
    return run


def _file(path: str | os.PathLike[str]) -> CachingFileManager:
    """Return a file that xarray opens when it is needed."""
    open_file = cast(Callable[..., BinaryIO], dataset_at)  # cast: its `close` returns a value
    return CachingFileManager(open_file, os.path.abspath(path), mode="r", lock=LIBRARY)


def _store(file: CachingFileManager, group: str | None = None) -> NetCDF4DataStore:
    """Return a group of a file for xarray."""
    return NetCDF4DataStore(file, group=group, mode="r", lock=LIBRARY)


def dataset_in_memory(memory: RunInMemory) -> xr.Dataset:
    """Return the Dataset of a run without a file, as open_run would for its file; all values are in memory."""
    assert memory.state is not None
    attributes, groups = memory.contents()
    sizes = {"": {}, "contacts": {}, "grains": memory.state.sizes}
    parts = [
        xr.Dataset(
            {
                name: xr.Variable(row.dimensions, values, row.attributes, storage(row, sizes[group], bool(group)))
                for name, (row, values) in variables.items()
            },
            attrs={} if group else attributes,
        )
        for group, variables in groups.items()
    ]
    return _join(parts)


def datasets_of(runs: Mapping[str, Any]) -> dict[str, xr.Dataset]:
    """Return the Datasets of named runs, given as Runs or Datasets. Raises InputError for anything else."""
    require_type(runs, Mapping, "runs", "{'dense': labkit.Run.open('dense.run.nc')}")
    data = {name: getattr(run, "data", run) for name, run in runs.items()}
    for run in data.values():
        require_type(run, xr.Dataset, "runs", "labkit.Run.open('dense.run.nc') for each name")
    return data


def short_names(files: Sequence[str | os.PathLike[str]]) -> list[str]:
    """Return the names of run files without folder and extension; their paths if two names would be the same.

    Raises InputError if a file is given twice.
    """
    if twice := [file for k, file in enumerate(files) if file in files[:k]]:
        raise InputError(f"{twice[0]} is given twice: give every run once")
    short = list(map(stem, files))
    return short if len(set(short)) == len(short) else list(map(str, files))


@contextlib.contextmanager
def open_records(path: str | os.PathLike) -> Iterator[xr.Dataset]:
    """Context with the records of a run file as a Dataset, without contacts and without decoding. Raises InputError."""
    with open_netcdf(path, "run"):
        pass
    with name_damage(path):
        with LIBRARY:
            records = xr.open_dataset(_store(_file(path)), decode_cf=False, cache=False)
        with records:
            yield records


@xr.register_datatree_accessor("lab")
def tree_accessor(tree: xr.DataTree) -> Lab:
    """Return the accessor `.lab` of a run file opened with xarray.open_datatree. Raises InputError for any other tree.

    The accessor is registered when this module is imported.
    """
    if not {"contacts", "grains"} <= set(tree.children):
        raise InputError("this tree is not a labkit run: open a run file, or use labkit.open_state for a state file")
    parts = [each.to_dataset(inherit=False) for each in (tree, tree.children["contacts"], tree.children["grains"])]
    return _join(parts).lab


def in_seconds(part: xr.Dataset) -> xr.Dataset:
    """Convert the time of a Dataset, which xarray may have decoded as dates in ns, to s since the start of the path."""
    if "time" not in part.variables:
        return part
    time = part["time"].values
    if time.dtype.kind == "M":
        time = (time - np.datetime64(EPOCH)) / np.timedelta64(1, "s")
    return part.assign_coords(time=("time", time, {"units": "s", "long_name": RECORD["time"].long_name}))


def _join(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join the root, the contacts and the grains of a run file in one Dataset."""
    run = xr.merge([in_seconds(part) for part in parts], compat="no_conflicts", join="exact", combine_attrs="override")
    starts, record = np.concatenate([[0], np.cumsum(run["row_size"].values)[:-1]]), run["record"].values
    run = run.assign_coords(
        row_start=("snapshot", starts[: run.sizes["snapshot"]], {"units": "1", "long_name": "first contact row"}),
        snapshot_cell=(("snapshot", "i", "j"), run["cell"].values[record], run["cell"].attrs),
        snapshot_strain=("snapshot", run["axial_strain"].values[record], run["axial_strain"].attrs),
    )
    if "time" in run:
        run = run.assign_coords(snapshot_time=("snapshot", run["time"].values[record], run["time"].attrs))
    for variable in RECORD.values():  # variables missing in files of earlier versions or other programs are NaN
        if variable.name not in run:
            shape = [run.sizes[dimension] for dimension in variable.dimensions]
            run[variable.name] = (variable.dimensions, np.full(shape, np.nan), variable.attributes)
    return with_axes(run.set_coords(["time", "axial_strain"]))


def dataset_of_state(state: State) -> xr.Dataset:
    """Return the variables and the attributes of a state file."""
    about = {name: getattr(state, name) for name in ATTRIBUTES} | {"scene": state.scene.to_json()}
    values = {name: (row.dimensions, state.arrays[name], row.attributes) for name, row in state.table.items()}
    return xr.Dataset(values, attrs=about)


def open_state(path: str | os.PathLike[str], snapshot: int | None = None) -> xr.Dataset:
    """Open a state file as one lazy xarray.Dataset with the variables of labkit.files.schema.STATE.

    For a run file, the Dataset contains the State that labkit.read_state returns for `snapshot`. Raises InputError.
    """
    require_file_name(path, "labkit.open_state('s.state.nc')")
    if labkit_kind(path) == "run" or snapshot is not None:
        return with_axes(dataset_of_state(read_state(path, snapshot=snapshot)))
    return open_whole(path, "state")


def open_whole(path: str | os.PathLike[str], kind: str) -> xr.Dataset:
    """Open a file of this kind that has no groups, "state" or "probes", as one lazy Dataset. Raises InputError."""
    with open_netcdf(path, kind):
        pass
    with LIBRARY, name_damage(path):
        dataset = with_axes(xr.open_dataset(_store(_file(path)), decode_times=False))
    dataset.encoding["source"] = str(path)
    return dataset


def snapshots(file: str | os.PathLike, numbers: Iterable[int] | None = None) -> Iterator[Snapshot]:
    """Yield the Snapshots of a run file, or the Snapshot of a state file; only one is in memory at a time.

    `numbers` selects snapshots of a run file (default: all); negative numbers count from the end. Raises InputError if
    the file lacks them.
    """
    chosen = None if numbers is None else list(numbers)
    if labkit_kind(file) == "state":
        if chosen:
            raise InputError(
                f"is for run files, and {file} is a state file: leave it out", field="snapshot", value=chosen[0]
            )
        return (read_state(file).snapshot() for _ in range(1))
    run = open_run(file)
    run.lab.require_snapshots(chosen or (-1,), ", or a state file")
    return run.lab.snapshots(chosen)
