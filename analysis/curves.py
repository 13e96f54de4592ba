"""Curves of many tests as one small data set: stress ratio, fabric, forces and void ratio against strain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

from analysis.critical_state.ends import QUANTITIES, quantities_of
from labkit.runs import Run

C0 = ("c0_norm", "c0_q")  # relative errors of C0: in the Frobenius norm, and in q
POINTS = 101  # records kept of each run, at equal intervals of the accumulated strain
CURVES = "curves.nc"
AT_FULL_STRAIN = "critical_state/statistics.nc"  # tests to 100 % strain, at an inertial number of 2.5e-4


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


def curves_at_full_strain(results: Path, grains: Mapping[str, int], strain: float) -> dict[str, xr.Dataset]:
    """Read curves of tests stored in results/critical_state, at POINTS strains up to `strain`, by their name there.

    Tests that are missing there are left out.

    Args:
        results: Folder of all results.
        grains: Number of grains, name -> number.
        strain: Largest strain.
    """
    file = results / AT_FULL_STRAIN
    if not file.exists():
        return {}
    at = np.linspace(0.0, strain, POINTS)
    curves = {}
    with xr.open_dataset(file) as data:
        for name in (name for name in grains if name in data["run"].values):
            run = data.sel(run=name)
            known = run["accumulated_strain"].values.astype(float)
            columns = {key: np.interp(at, known, values) for key, values in quantities_of(run).items()}
            columns |= dict.fromkeys(C0, np.full(POINTS, np.nan))  # not stored there
            curves[name] = xr.Dataset({key: ("point", values) for key, values in {"strain": at, **columns}.items()})
            curves[name]["grains"] = grains[name]
    return curves


def read_curves(file: Path) -> pandas.DataFrame:
    """The curves of a data set, a row per record: run, test, specimen, grains, strain, QUANTITIES, and C0 if stored."""
    with xr.open_dataset(file) as data:
        columns = ["strain", *QUANTITIES, *(key for key in C0 if key in data)]
        table = data[["grains", *columns]].to_dataframe().reset_index()
    names = table["run"].str.partition("-")
    return table.assign(test=names[0], specimen=names[2]).astype(dict.fromkeys(columns, float))


def window_means(curves: pandas.DataFrame, begin: float, end: float) -> pandas.DataFrame:
    """Means of QUANTITIES over begin <= strain <= end, a row per run: run, test, specimen, grains, QUANTITIES."""
    inside = curves[(curves["strain"] >= begin) & (curves["strain"] <= end)]
    return inside.groupby(["run", "test", "specimen", "grains"], sort=False, as_index=False)[list(QUANTITIES)].mean()
