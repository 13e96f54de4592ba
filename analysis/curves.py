"""Curves of many tests as one small data set: stress ratio, fabric, forces and void ratio against strain."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from analysis.critical_state.ends import quantities_of
from labkit.results import Run

POINTS = 101  # records kept of each run, at equal intervals of the accumulated strain


def each_run(data: xr.Dataset) -> Iterator[tuple[str, xr.Dataset]]:
    """(name, run) of a data set with the dimension run."""
    for name in map(str, data["run"].values):
        yield name, data.sel(run=name)


def turns(strain: np.ndarray) -> np.ndarray:
    """Indices of the records at which the axial strain (record,) reverses, without the first and last record."""
    return np.flatnonzero(np.diff(np.sign(np.diff(strain))) != 0) + 1


def accumulated_strain(run: xr.Dataset) -> np.ndarray:
    """Accumulated strain at the records of a run, (time,)."""
    if "accumulated_strain" in run:  # recorded if the rate is not constant
        return run["accumulated_strain"].values.astype(float)
    path = Run(run).path
    assert path is not None
    return run["time"].values.astype(float) * path.rate


def curves_of(run: xr.Dataset) -> xr.Dataset:
    """strain (accumulated), QUANTITIES and C0 at POINTS records of a run, dimension point, and the number of grains."""
    strain = accumulated_strain(run)
    chosen = np.abs(strain[:, None] - np.linspace(0.0, strain[-1], POINTS)).argmin(axis=0)
    kept = run.isel(time=chosen)
    errors = {"c0_norm": kept.lab.sff_error().values, "c0_q": kept.lab.sff_errors()["q"].values}
    columns = {"strain": strain[chosen], **quantities_of(kept), **errors}
    data = xr.Dataset({name: ("point", values) for name, values in columns.items()})
    data["grains"] = run.sizes["grain"]
    return data
