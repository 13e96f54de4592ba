"""All runs of a campaign as one labelled object that is loaded lazily.

runs = labkit.open_campaign("quick")                     # an xarray.Dataset, dimensions run and time
runs["stress"].sel(run="cp-dense-fused")                 # reads one file
runs.isel(run=(runs["path"] == "cp").values)             # still lazy: the parameters are in memory
runs.lab.stress_ratio().sel(run="cp-dense-fused")        # as for one run, but with the dimensions run and time
runs.runs.summary().to_dataframe()                       # one row per run; one run in memory at a time
runs.runs.open("cp-dense-fused").lab.contacts(3)         # contacts of one run, see labkit.open_run
"""

from __future__ import annotations

import glob
import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from xarray.backends import BackendArray
from xarray.core import indexing

from labkit.errors import InputError, require_file_name
from labkit.files.netcdf import open_netcdf
from labkit.files.schema import RECORD, SIZES, Variable, number_of_bodies
from labkit.grains.scene import Scene
from labkit.parameters import Parameter, parameters_of
from labkit.paths.registry import PATHS
from labkit.plugins.campaigns.layout import RECIPES
from labkit.plugins.campaigns.products import Numbers, numbers
from labkit.results.dataset import in_seconds, open_records, open_run, short_names
from labkit.results.run import Run
from labkit.results.several import separate
from labkit.results.tables import with_axes
from labkit.specimens.recipe import Recipe

OF_FILES = {  # coordinate -> long name; all other coordinates are parameters of the path, scene or recipe
    "path": "loading path",
    "engine": "engine",
    "specimen": "state or run file from which the run started",
    "seed": "seed of the specimen",
    "grains": "number of grains",
    "records": "number of records; later elements of the arrays are NaN",
    "complete": "True if the run is finished",
    "file": "run file",
}
BEYOND = 0.05  # part of an interval between two records; a time step is shorter
PREFIX = {"path": "target_", "recipe": "specimen_"}  # prefixes of parameters that share the name of a recorded variable


class _File(NamedTuple):
    """The contents of a run file: coordinates, name -> (value, attributes), and recorded variables."""

    coordinates: dict[str, tuple[object, dict[str, str]]]
    variables: dict[str, Variable]
    records: int


def open_campaign(*places: str | Path) -> xr.Dataset:
    """Open the runs of campaign folders, or run files, as one lazy xarray.Dataset.

    Its dimensions are `run` (with the name as coordinate), `time` (records; shorter runs are padded with NaN), `i` and
    `j` (x, y, z). Its variables are user-defined statistics and those of labkit.files.schema.RECORD that at least one
    run contains; its accessor `.lab` has the quantities of the records of each run, as in labkit.open_run. Its
    coordinates along `run` are parameters of the paths, scenes and specimens. A parameter whose name clashes with a
    recorded variable gets a prefix: `target_strain` is the strain to reach, `specimen_void_ratio` the void ratio of the
    recipe. Raises InputError for a path that does not exist or contains no run files.
    """
    for place in places:
        require_file_name(place, "labkit.open_campaign('mine'), or labkit.open_runs for a list of run files")
    return _as_one(run_files(places))


def open_runs(files: str | os.PathLike[str] | Run | Iterable[str | os.PathLike[str] | Run]) -> xr.Dataset:
    """Open run files as one lazy xarray.Dataset along `run`, with the parameters that differ as coordinates.

    Otherwise as labkit.open_campaign: records are numbered along `time`, and shorter runs are padded with NaN;
    `.runs.interpolate` puts all runs on common strains. Raises InputError for anything but run files.

    Args:
        files: The run files, a pattern such as `results/*.run.nc`, or Runs with files.
    """
    if isinstance(files, (str, os.PathLike)):
        files = _files_like(os.fspath(files))
    listed = [_file_of(run) for run in (files if isinstance(files, Iterable) else [files])]
    if not listed:
        raise InputError("open_runs() got no files: give run files, or a pattern such as 'results/*.run.nc'")
    for file in listed:
        if not file.is_file():
            raise InputError(f"{file} does not exist: give run files, or a pattern such as 'results/*.run.nc'")
    runs = _as_one(listed)
    same = [name for name in runs.coords if name not in ("run", *OF_FILES) and runs[name].dims == ("run",)]
    return runs.drop_vars([name for name in same if len(set(map(str, runs[name].values.tolist()))) == 1])


def _files_like(pattern: str) -> list[str]:
    """Return the files that a pattern describes; a file or a folder that exists is a name, not a pattern."""
    folder, name = os.path.split(pattern)
    inside = os.path.join(glob.escape(folder), name) if os.path.isdir(folder) else pattern
    return [pattern] if os.path.exists(pattern) else sorted(glob.glob(inside)) or [pattern]


def _file_of(run: str | os.PathLike[str] | Run) -> Path:
    """Return the file of a run. Raises InputError for a run in memory, or what is no run."""
    if isinstance(run, Run) and run.file is None:
        raise InputError("a run in memory has no file: give lk.run(..., file='r.run.nc')")
    file = run.file if isinstance(run, Run) else run
    if not isinstance(file, (str, os.PathLike)):
        raise InputError(f"open_runs() got a {type(file).__name__}: give run files, or Runs with files")
    return Path(file)


def _as_one(files: Sequence[Path]) -> xr.Dataset:
    """Open run files as one lazy Dataset; see open_campaign."""
    contents = [_read(file) for file in files]
    variables = {name: variable for file in contents for name, variable in file.variables.items()}
    present = [name for name in (*RECORD, *sorted(set(variables) - set(RECORD))) if name in variables]
    records = [file.records for file in contents]
    data = {name: _variable(variables[name], files, records) for name in present}
    names = dict.fromkeys(name for file in contents for name in file.coordinates)
    columns = {name: _column([file.coordinates.get(name) for file in contents]) for name in names}
    return with_axes(xr.Dataset(data, {"run": ("run", short_names(files)), **columns}, {"labkit_file": "campaign"}))


def run_files(places: Sequence[str | Path]) -> list[Path]:
    """List the run files in campaign folders and in folders of run files, and any given by name."""
    if not places:
        raise InputError("open_campaign() needs a path: give a campaign folder or run files")
    files: list[Path] = []
    for place in map(Path, places):
        if not place.exists():
            raise InputError(f"{place} does not exist: give a campaign folder or run files")
        folder = place / "runs" if (place / "runs").is_dir() else place
        in_place = sorted(folder.glob("*.run.nc")) if place.is_dir() else [place]
        if (place / RECIPES).is_dir():
            planned = {file.name for file in (place / RECIPES).glob("run.*.json")}  # runs of the current campaign file
            in_place = [file for file in in_place if f"run.{file.name.removesuffix('.run.nc')}.json" in planned]
        if not in_place:
            raise InputError(f"{place} contains no run files: give a campaign folder or run files")
        files += in_place
    return files


def _attributes(units: str, long_name: str) -> dict[str, str]:
    return {"long_name": long_name, **({"units": units} if units else {})}


def _column(cells: Sequence[tuple[object, dict[str, str]] | None]) -> tuple[str, list[object], dict[str, str]]:
    """Return a coordinate along `run`, with NaN or an empty string for a run that lacks it."""
    first = next(cell for cell in cells if cell is not None)
    is_text = any(isinstance(cell[0], str) for cell in cells if cell is not None)
    values = [("" if is_text else np.nan) if cell is None or cell[0] is None else cell[0] for cell in cells]
    return "run", values, first[1]


def _read(file: Path) -> _File:
    with open_netcdf(file, "run") as run:
        texts = {name: getattr(run, name, "") for name in ("recipe", "provenance", "path_parameters", "scene")}
        stored = {name: json.loads(text) if text else {} for name, text in texts.items()}
        inputs, name = [source["file"] for source in stored["provenance"].get("inputs", [])], run.getncattr("path")
        records = len(run.dimensions["time"])
        of_file = {
            "path": name,
            "engine": str(run.engine),
            "specimen": next((Path(file).name for file in inputs if str(file).endswith((".state.nc", ".run.nc"))), ""),
            "seed": int(getattr(run, "seed", 0)),
            "grains": number_of_bodies({name: len(size) for name, size in run["grains"].dimensions.items()}),
            "records": records,
            "complete": bool(run.complete),
            "file": str(file),
        }
        coordinates = {key: (value, _attributes("", OF_FILES[key])) for key, value in of_file.items()}
        kind = PATHS[name] if name in PATHS else None
        coordinates = {
            **_parameters("recipe", stored["recipe"], parameters_of(Recipe)),
            **_parameters("scene", stored["scene"], parameters_of(Scene)),
            **_parameters("path", stored["path_parameters"], parameters_of(kind) if kind else {}),
            **coordinates,
        }
        return _File(
            coordinates,
            {name: _variable_of(variable) for name, variable in run.variables.items() if _is_recorded(variable)},
            records,
        )


def _parameters(
    of: str, values: Mapping[str, object], parameters: Mapping[str, Parameter]
) -> dict[str, tuple[object, dict[str, str]]]:
    """Return coordinates for all parameters of a path, scene or recipe in a file; known ones have units and help."""
    coordinates = {}
    for name, value in values.items():
        if isinstance(value, (list, tuple)):
            value = ",".join(f"{number:g}" if isinstance(number, float) else str(number) for number in value)
        units, help = (parameters[name].unit, parameters[name].help) if name in parameters else ("", name)
        coordinates[PREFIX.get(of, "") * (name in RECORD) + name] = value, _attributes(units, help)
    return coordinates


def _is_recorded(variable: netCDF4.Variable) -> bool:
    """Return True for numbers along time, of which each record has the same number."""
    first, *others = variable.dimensions or [""]
    numbers = isinstance(variable.datatype, np.dtype) and variable.dtype.kind in "biuf"  # not a type of the file
    return numbers and first == "time" and set(others) <= set(SIZES)


def _variable_of(variable: netCDF4.Variable) -> Variable:
    """Return a recorded variable as labkit defines it or, if it is not labkit's, as the file describes it."""
    attributes = [str(getattr(variable, name, "")) for name in ("units", "long_name")]
    row = Variable(variable.name, variable.dimensions, "f8", *attributes)
    return RECORD.get(variable.name, row)


class _Records(BackendArray):
    """A recorded variable of all runs, (run, time, ...); reads only the files of the selected runs."""

    def __init__(self, name: str, files: Sequence[Path], records: Sequence[int], shape: tuple[int, ...]) -> None:
        self.name, self.files, self.records = name, files, records
        self.shape, self.dtype = shape, np.dtype(float)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        chosen = np.arange(self.shape[0])[key[0]]
        rest = tuple(key[1:])
        values = [self._read_one(int(run))[rest] for run in np.atleast_1d(chosen)]
        return np.array(values) if np.ndim(chosen) else values[0]

    def _read_one(self, run: int) -> np.ndarray:
        values = np.full(self.shape[1:], np.nan)
        with open_netcdf(self.files[run], "run") as dataset:
            if self.name in dataset.variables:
                values[: self.records[run]] = np.ma.filled(dataset[self.name][...], np.nan)
        return values


def _rows_at(values: np.ndarray, at: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that interpolates rows, given at increasing or decreasing `at`, to `values`; NaN outside.

    A run ends within a time step of its target: a value a small part of an interval beyond the end is that of the end.
    """
    order = slice(None, None, 1 if at[-1] >= at[0] else -1)
    edge, first, last = BEYOND * np.ptp(at) / max(at.size - 1, 1), at.min(), at.max()
    inside = np.where((values > first - edge) & (values < last + edge), values.clip(first, last), np.nan)
    place = np.interp(inside, at[order], np.arange(at.size)[order])
    lower = np.nan_to_num(place).astype(int)
    upper, share = np.minimum(lower + 1, at.size - 1), place - lower

    def rows_at(rows: np.ndarray) -> np.ndarray:
        return rows[lower] + share.reshape(-1, *[1] * (rows.ndim - 1)) * (rows[upper] - rows[lower])

    return rows_at


def _variable(row: Variable, files: Sequence[Path], records: Sequence[int]) -> xr.Variable:
    shape = (len(files), max(records), *(SIZES[dimension] for dimension in row.dimensions[1:]))
    data = indexing.LazilyIndexedArray(_Records(row.name, files, records, shape))
    return xr.Variable(("run", *row.dimensions), data, _attributes(row.units, row.long_name))


@xr.register_dataset_accessor("runs")
class Runs:
    """Operations on a campaign, or on a selection of its runs, as `campaign.runs`."""

    def __init__(self, campaign: xr.Dataset) -> None:
        """Take a Dataset from labkit.open_campaign, or a selection of it."""
        self._campaign = campaign

    def open(self, name: str) -> xr.Dataset:
        """Open one run with its contacts, as labkit.open_run does."""
        return open_run(str(self._campaign["file"].sel(run=name).values))

    def over(self, function: Callable[[xr.Dataset], Numbers]) -> xr.Dataset:
        """Apply `function(records)` to every run, one run in memory at a time; returns a Dataset along `run`.

        The function receives the records of one run as a Dataset along `time`, with the accessor `.lab` but without
        contacts, and returns name -> (value, units, long name). The result keeps the parameters as coordinates.
        """
        files = np.atleast_1d(self._campaign["file"].values)
        rows = []
        for file in files:
            with open_records(file) as records:
                coordinates = [name for name in ("time", "axial_strain") if name in records]
                rows.append(function(in_seconds(records).set_coords(coordinates)))
        names = list(dict.fromkeys(name for row in rows for name in row))
        missing = (np.nan, "", "")
        columns = {
            name: (
                "run",
                [row.get(name, missing)[0] for row in rows],
                _attributes(*next(row[name] for row in rows if name in row)[1:]),
            )
            for name in names
        }
        return xr.Dataset(columns, coords={name: c for name, c in self._campaign.coords.items() if c.dims == ("run",)})

    def interpolate(self, values: ArrayLike, along: str = "axial_strain") -> xr.Dataset:
        """Interpolate all records linearly to common values of a quantity, instead of the number of the record.

        Returns a Dataset in memory with the dimensions `run` and `along`; it is NaN where a run does not reach a value.
        Raises InputError for an unknown quantity, or one that does not always increase or always decrease in a run.

        Args:
            values: Values of the quantity, shape (value,), e.g. axial strains.
            along: A quantity of the records, such as axial_strain, gamma_xz or accumulated_strain.
        """
        chosen = np.asarray(values, dtype=float)
        runs = self._campaign if "run" in self._campaign.dims else self._campaign.expand_dims("run")
        recorded = [name for name, variable in runs.data_vars.items() if "time" in variable.dims]
        arrays = {name: np.empty((runs.sizes["run"], chosen.size, *runs[name].shape[2:])) for name in recorded}
        for number, name in enumerate(runs["run"].values.tolist()):
            records = runs.isel(run=number, time=slice(int(runs["records"][number])))
            scale = next(separate(records)).lab.quantity(along)
            at = scale.values
            steps = np.diff(at)
            if not ((steps > 0.0).all() or (steps < 0.0).all()):
                raise InputError(f"{along} of {name} turns back or stands still: choose another quantity")
            rows = _rows_at(chosen, at)
            for variable, array in arrays.items():
                array[number] = rows(records[variable].values)
        columns = {
            name: (("run", along, *runs[name].dims[2:]), array, runs[name].attrs)
            for name, array in arrays.items()
            if name != along
        }
        of_runs = {name: column for name, column in runs.coords.items() if "time" not in column.dims}
        return xr.Dataset(columns, {**of_runs, along: (along, chosen, scale.attrs)}, {"labkit_file": "campaign"})

    def summary(self) -> xr.Dataset:
        """Compute the numbers reported for every run: end values, peaks, the critical state, the error of C0.

        The coordinates are the path and the parameters in which the runs differ; the Dataset of the campaign has all.
        A number that has no meaning for any of the runs is left out.
        """
        table = self.over(numbers)
        same = [name for name, column in table.coords.items() if len(set(map(str, column.values.tolist()))) == 1]
        empty = [name for name, column in table.data_vars.items() if bool(column.isnull().all())]
        return table.drop_vars({*same, *empty, "file"} & set(table.variables) - {"run", "path"})
