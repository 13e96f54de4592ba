"""The accessor `.lab` of a campaign: quantities of all its runs, along `run` and `time`."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Concatenate, ParamSpec, TypeVar

import numpy as np
import xarray as xr

from labkit.errors import InputError
from labkit.files.netcdf import open_netcdf
from labkit.files.schema import SIZES

Arguments = ParamSpec("Arguments")
Kind = TypeVar("Kind", bound="Accessor")


class Accessor:
    """An accessor of a run, some of whose methods also take the runs of a campaign."""

    def __init__(self, data: xr.Dataset) -> None:
        """Store a run, or the runs of a campaign; xarray calls this when `.lab` is first used."""
        self.data = data

    @property
    def is_campaign(self) -> bool:
        """True for runs that labkit.open_campaign or open_runs opened, or a selection of them."""
        return self.data.attrs.get("labkit_file") == "campaign"

    @property
    def _run(self) -> xr.Dataset:
        """The run. Raises InputError for a campaign."""
        if self.is_campaign:
            raise InputError("a campaign has several runs: open one of them, campaign.runs.open(name).lab")
        return self.data


def for_each_run(
    method: Callable[Concatenate[Kind, Arguments], xr.DataArray],
) -> Callable[Concatenate[Kind, Arguments], xr.DataArray]:
    """Return a method of an accessor that also takes a campaign: its DataArray then has the dimensions run and time."""

    @functools.wraps(method)
    def of_all(lab: Kind, *arguments: Arguments.args, **named: Arguments.kwargs) -> xr.DataArray:
        if not lab.is_campaign:
            return method(lab, *arguments, **named)
        results = [method(type(lab)(run), *arguments, **named) for run in separate(lab.data)]
        values = np.full((len(results), lab.data.sizes["time"]), np.nan)
        for row, result in zip(values, results, strict=True):
            row[: len(result)] = result.values
        table = xr.DataArray(values, dims=("run", "time"), name=results[0].name, attrs=results[0].attrs)
        return table.assign_coords(run=lab.data["run"]) if "run" in lab.data.dims else table[0]

    return of_all


def separate(runs: xr.Dataset) -> Iterator[xr.Dataset]:
    """Yield each run of a campaign with the attributes of its file, without the records that pad it."""
    for number, file in enumerate(np.atleast_1d(runs["file"].values).tolist()):
        run = runs.isel(run=number) if "run" in runs.dims else runs
        with open_netcdf(file, "run") as dataset:
            attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        others = [name for name in run.dims if name not in SIZES]
        if others != ["time"]:
            raise InputError(f"these records are at common values of {others[0]}: use .lab before .runs.interpolate")
        yield run.isel(time=np.isfinite(run["axial_strain"].values)).assign_attrs(attributes)
