"""The accessor `.lab` of the runs of a campaign."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import xarray as xr

from labkit.io.netcdf import open_netcdf
from labkit.runs.accessor import Lab
from labkit.runs.of_records import OfRecords


class OfRuns:
    """The accessor `.lab` of a campaign: what OfRecords computes from the records of a run, for every run."""

    def __init__(self, runs: xr.Dataset) -> None:
        """`runs`: Dataset of labkit.open_campaign, or a selection of its runs and records."""
        self._runs = runs

    def __getattr__(self, name: str) -> Callable[..., object]:
        """A method of OfRecords: it returns a DataArray along `run` and `time`, or else a list of results."""
        if name.startswith("_") or not callable(getattr(OfRecords, name, None)):
            raise AttributeError(f"a campaign has no lab.{name}: open one of its runs, campaign.runs.open(name).lab")

        def of_all(*arguments: object, **named: object) -> object:
            results = [getattr(Lab(run), name)(*arguments, **named) for run in self._separate()]
            if not all(isinstance(one, xr.DataArray) and one.dims == ("time",) for one in results):
                return results if "run" in self._runs.dims else results[0]
            values = np.full((len(results), self._runs.sizes["time"]), np.nan)
            for row, one in zip(values, results, strict=True):
                row[: len(one)] = one.values
            made = xr.DataArray(values, dims=("run", "time"), name=results[0].name, attrs=results[0].attrs)
            return made.assign_coords(run=np.atleast_1d(self._runs["run"])) if "run" in self._runs.dims else made[0]

        return of_all

    def _separate(self) -> Iterator[xr.Dataset]:
        """Return each run with the attributes of its file, without the records that pad it."""
        for number, file in enumerate(np.atleast_1d(self._runs["file"].values).tolist()):
            one = self._runs.isel(run=number) if "run" in self._runs.dims else self._runs
            with open_netcdf(file, "run", verify=False) as dataset:
                attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
            yield one.isel(time=np.isfinite(one["axial_strain"].values)).assign_attrs(attributes)
