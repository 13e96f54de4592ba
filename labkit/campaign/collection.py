"""All runs of a campaign as one labelled object that reads nothing before it is asked.

    runs = labkit.open_campaign("quick")                     # an xarray.Dataset, dimensions run and time
    runs["stress"].sel(run="cp-dense-fused")                 # reads one file
    runs.isel(run=(runs["path"] == "cp").values)             # still lazy: the parameters are in memory
    runs.runs.summary().to_dataframe()                       # one row per run; one run in memory at a time
    runs.runs.open("cp-dense-fused").lab.contacts(3)         # the contacts of one run, see labkit.open_run
"""

from __future__ import annotations

import json
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from labkit.campaign.plan import RECIPES
from labkit.campaign.products import numbers
from labkit.runs.dataset import open_run
from labkit.errors import InputError
from labkit.io.files import open_netcdf
from labkit.io.schema import RECORD, SIZES

PARAMETERS = {  # coordinate -> units, words
    "path": ("", "loading path"),
    "engine": ("", "engine"),
    "specimen": ("", "state file that the run started from"),
    "seed": ("1", "seed of the specimen"),
    "specimen_void_ratio": ("1", "nominal void ratio of the specimen as made"),
    "step1_friction": ("1", "friction of the first relaxation step"),
    "pressure": ("Pa", "stress that the path holds or stops at"),
    "strain": ("1", "axial strain to reach"),
    "rate": ("s-1", "axial strain rate"),
    "time_step_factor": ("1", "time step over sqrt(m/kn)"),
    "grains": ("1", "number of grains"),
    "records": ("1", "number of records; beyond it the arrays are NaN"),
    "complete": ("", "whether the run is finished"),
    "file": ("", "run file"),
}


def open_campaign(*places):
    """The runs of campaigns, of folders or run files, as one lazy xarray.Dataset.

    Dimensions `run` (coordinate: the name) and `time` (records; shorter runs end in NaN), `i`, `j`. Variables are those
    of labkit.io.schema.RECORD that any run has; the parameters of the runs are coordinates along `run`. Raises InputError
    for a place without run files.
    """
    files = run_files(places)
    rows = [_parameters(file) for file in files]
    columns = {name: [row[name] for row in rows] for name in PARAMETERS}
    names = _names(files)
    shape = len(files), max(columns["records"])
    present = [name for name in RECORD if any(name in row["variables"] for row in rows)]
    found = xr.Dataset({name: _variable(name, files, columns["records"], shape) for name in present})
    coordinates = {name: ("run", columns[name], _attributes(*words)) for name, words in PARAMETERS.items()}
    return found.assign_coords(run=("run", names), **coordinates).assign_attrs(labkit_file="campaign")


def run_files(places):
    """The run files of folders of campaigns, of folders of run files, and those that are named."""
    if not places:
        raise InputError("open_campaign() needs a place: give the folder of a campaign, or run files")
    files = []
    for place in map(Path, places):
        folder = place / "runs" if (place / "runs").is_dir() else place
        found = sorted(folder.glob("*.run.nc")) if place.is_dir() else [place]
        if (place / RECIPES).is_dir():
            found = [file for file in found if (place / recipe_of(file)).exists()]  # not of earlier campaign files
        if not found:
            raise InputError(f"{place} holds no run files: give the folder of a campaign, or run files")
        files += found
    return files


def recipe_of(file):
    return f"{RECIPES}/run.{file.name.removesuffix('.run.nc')}.json"


def _names(files):
    short = [file.name.removesuffix(".run.nc") for file in files]
    return short if len(set(short)) == len(short) else [str(file) for file in files]


def _attributes(units, words):
    return {"long_name": words, **({"units": units} if units else {})}


def _parameters(file):
    """The value of every one of PARAMETERS of a run file, and its variables."""
    with open_netcdf(file, "run") as run:
        known = {name: getattr(run, name, "") for name in ("recipe", "provenance")}
        known = {name: json.loads(text) if text else {} for name, text in known.items()}
        path, scene = json.loads(run.path_parameters), json.loads(run.scene)
        inputs = known["provenance"].get("inputs", [])
        given = {name: path.get(name) for name in ("pressure", "strain", "rate")}
        given |= {"specimen_void_ratio": known["recipe"].get("void_ratio"),
                  "step1_friction": known["recipe"].get("step1_friction"),
                  "time_step_factor": scene.get("time_step_factor")}  # fmt: skip
        return {
            **{name: np.nan if value is None else float(value) for name, value in given.items()},
            "path": run.getncattr("path"), "engine": str(run.engine), "seed": int(getattr(run, "seed", 0)),
            "specimen": Path(inputs[0]["file"]).name if inputs else "",
            "grains": len(run["grains"].dimensions["grain"]), "records": len(run.dimensions["time"]),
            "complete": bool(run.complete), "file": str(file), "variables": set(run.variables),
        }  # fmt: skip


class _Records(BackendArray):
    """A recorded variable of all runs, (run, time, ...); reads the files of the runs that are asked for."""

    def __init__(self, name, files, records, shape):
        self.name, self.files, self.records = name, files, records
        self.shape, self.dtype = shape, np.dtype(float)

    def __getitem__(self, key):
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key):
        chosen = np.arange(self.shape[0])[key[0]]
        rest = tuple(key[1:])
        values = [self._read_one(int(run))[rest] for run in np.atleast_1d(chosen)]
        return np.array(values) if np.ndim(chosen) else values[0]

    def _read_one(self, run):
        values = np.full(self.shape[1:], np.nan)
        with netCDF4.Dataset(self.files[run]) as dataset:
            if self.name in dataset.variables:
                values[: self.records[run]] = dataset[self.name][...].filled(np.nan)
        return values


def _variable(name, files, records, shape):
    row = RECORD[name]
    full = (*shape, *(SIZES[dimension] for dimension in row.dimensions[1:]))
    data = indexing.LazilyIndexedArray(_Records(name, files, records, full))
    return xr.Variable(("run", *row.dimensions), data, _attributes(row.units, row.long_name))


@xr.register_dataset_accessor("runs")
class Runs:
    """What can be done with a campaign, or with a selection of its runs, as `campaign.runs`."""

    def __init__(self, campaign):
        self._campaign = campaign

    def open(self, name):
        """One run with its contacts, as labkit.open_run gives it."""
        return open_run(str(self._campaign["file"].sel(run=name).values))

    def over(self, function):
        """`function(records)` of every run, a Dataset along `run` with the parameters. One run in memory at a time.

        `records`: the records of one run as a Dataset along `time`, with the accessor `.lab` but without contacts;
        the function returns name -> (value, units, words).
        """
        files = np.atleast_1d(self._campaign["file"].values)
        rows = []
        for file in files:
            with xr.open_dataset(file, engine="netcdf4", decode_cf=False, cache=False) as records:
                rows.append(function(records.set_coords([n for n in ("time", "axial_strain") if n in records])))
        names = list(dict.fromkeys(name for row in rows for name in row))
        missing = (np.nan, "", "")
        columns = {
            name: ("run", [row.get(name, missing)[0] for row in rows],
                   _attributes(*next(row[name] for row in rows if name in row)[1:])) for name in names
        }  # fmt: skip
        return xr.Dataset(columns, coords={name: c for name, c in self._campaign.coords.items() if c.dims == ("run",)})

    def summary(self):
        """The numbers that the report has of every run: ends, peaks, the critical state, the error of C0."""
        return self.over(numbers)
