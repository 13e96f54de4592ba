"""One data set of all runs: records at equal intervals, and the equations related to C0 at the snapshots."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import labkit as lk
from analysis.netcdf import characters
from labkit.engines import Progress
from labkit.io import provenance_json, whole_file
from labkit.runs import Run

TITLE = "Loading paths beyond the paper's"
POINTS = 101  # records kept of each run, at equal intervals of the accumulated strain
KEPT = (
    "axial_strain",
    "strain",
    "stress",
    "stress_sff",
    "void_ratio",
    "void_ratio_nominal",
    "coordination_number",
    "mean_normalised_force",
    "contact_anisotropy",
    "normal_force_anisotropy",
    "mobilisation",
    "inertial_number",
)


def test_and_specimen(name: str) -> tuple[str, str]:
    """Test and specimen of a run of the campaign, e.g. ('extension', 's3') for `extension-s3`."""
    test, _, specimen = name.partition("-")
    return test, specimen


def reduced(run: xr.Dataset) -> xr.Dataset:
    """The records of one run along `point`, with the accumulated strain, and its snapshots along `snapshot`."""
    path = Run(run).path
    assert path is not None
    known = "accumulated_strain" in run  # recorded if the rate is not constant
    accumulated = run["accumulated_strain"].values if known else run["time"].values * path.rate
    wanted = np.linspace(0.0, accumulated[-1], POINTS)
    chosen = np.abs(accumulated[:, None] - wanted).argmin(axis=0)
    records = run[list(KEPT)].isel(time=chosen).drop_vars("time").rename(time="point")
    records["accumulated_strain"] = ("point", accumulated[chosen], {"units": "1", "long_name": "accumulated strain"})
    at = xr.Dataset({"stress_family": run.lab.sff_family(), "error_budget": run.lab.error_budget()})
    at = at.drop_vars(["row_start", "record", "snapshot"], errors="ignore")
    at["snapshot_stress"] = run.lab.at_snapshots("stress")
    at["snapshot_accumulated"] = ("snapshot", accumulated[run["record"].values])
    return xr.merge([records.reset_coords(drop=True), at.reset_coords(drop=True)])


def collect(files: Sequence[Path], output: Path, command: str, progress: Progress, title: str = TITLE) -> None:
    """Reduces run files to one data set, dimensions run, point, snapshot, i, j, form and part, and writes it.

    Coordinates along run: test, specimen, and the path with its parameters (JSON) as in the run files.
    """
    sets, names, paths = [], [], []
    for k, file in enumerate(files):
        names.append(file.name.removesuffix(".run.nc"))
        progress(k / len(files), f"reading {names[-1]}")
        with lk.open_run(file) as run:
            sets.append(reduced(run))
            paths.append((run.attrs["path"], run.attrs["path_parameters"]))
    data = xr.concat(sets, "run", join="outer").assign_coords(run=names)
    tests, specimens = zip(*map(test_and_specimen, names), strict=True)
    data = data.assign_coords(test=("run", list(tests)), specimen=("run", list(specimens)))
    data = data.assign_coords(path=("run", [p for p, _ in paths]), path_parameters=("run", [p for _, p in paths]))
    data.attrs = {"title": title, "provenance": provenance_json(command, files, output)}
    coding: dict[str, dict[str, Any]] = {str(name): {"dtype": "f4", "zlib": True} for name in data.data_vars}
    with whole_file(output) as temporary:
        data.to_netcdf(temporary, encoding=coding | characters(data))
