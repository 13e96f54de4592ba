"""The results of a study as one labelled data set: the netCDF file from which tables, figures and page are made."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import labkit as lk
from analysis.places import texts
from analysis.speed_error.design import Case, Design
from analysis.speed_error.jobs import result_file
from analysis.speed_error.observables import CHECKS, OBSERVABLES
from labkit.errors import InputError
from labkit.files import write_text

ABOUT: dict[str, str] = texts(__file__)["variables"]
UNITS = {"wall_time": "s", "yardstick": "s"}


def collect(design: Design, work: str | Path) -> xr.Dataset:
    """All results in the folder `work`, an xarray.Dataset (case, replicate, observable or check).

    Units are those of OBSERVABLES and CHECKS. Results of tests not yet run are NaN, with the status "not run".
    """
    replicates = max(len(case.seeds) for case in design.cases)
    shape = len(design.cases), replicates
    columns = {
        name: np.full(shape, np.nan) for name in ("grains", "steps", "wall_time", "yardstick", "time_step_over_limit")
    }
    value, check = np.full((*shape, len(OBSERVABLES)), np.nan), np.full((*shape, len(CHECKS)), np.nan)
    status, seeds = np.full(shape, "", dtype=object), np.zeros(shape, dtype=int)
    for i, case in enumerate(design.cases):
        for k, seed in enumerate(case.seeds):
            file = result_file(work, case, seed)
            result: dict[str, Any] = {"status": "not run", "values": {}}
            if file.exists():
                result = json.loads(file.read_text())
            seeds[i, k], status[i, k] = seed, result["status"]
            for name, column in columns.items():
                column[i, k] = result.get(name, np.nan)
            value[i, k] = [result["values"].get(name, np.nan) for name in OBSERVABLES]
            check[i, k] = [result["values"].get(name, np.nan) for name in CHECKS]
    cells = ("case", "replicate")
    data = xr.Dataset(
        {
            "value": ((*cells, "observable"), value),
            "check": ((*cells, "check_name"), check),
            "seed": (cells, seeds),
            "status": (cells, status.astype(str)),
            **{name: (cells, column) for name, column in columns.items()},
        },
        coords={
            "case": [case.name for case in design.cases],
            "observable": list(OBSERVABLES),
            "check_name": list(CHECKS),
            **{
                name: ("case", [str(getattr(case, name)) for case in design.cases])
                for name in ("path", "factor", "level", "engine")
            },
            "guarded": ("case", [int(case.guarded) for case in design.cases]),
            "rate": ("case", [case.rate for case in design.cases], {"units": "s-1", "long_name": "axial strain rate"}),
            "strain": ("case", [case.strain for case in design.cases], {"units": "1", "long_name": "axial strain"}),
        },
        attrs={
            "Conventions": "CF-1.11",
            "labkit_version": lk.__version__,
            "title": "speed against error of labkit's settings",
        },
    )
    for name, description in ABOUT.items():
        data[name].attrs |= {"long_name": description, "units": UNITS.get(name, "1")}
    return data


def open_study(file: str | Path) -> xr.Dataset:
    """The data set of an earlier study. Raises InputError if the file is not one."""
    try:
        data = xr.open_dataset(file)
    except (OSError, ValueError) as error:
        raise InputError(f"{file} cannot be read as a study file ({error}): choose the study.nc of a study") from None
    if not {"value", "check", "status", "yardstick"} <= set(data):
        raise InputError(f"{file} is not a study file: choose the study.nc of a study")
    return data


def restore(data: xr.Dataset, design: Design, work: str | Path) -> int:
    """Writes the results of an earlier study into the folder `work`, and returns their number.

    A study with further cases, or on another computer, then need not repeat these tests. `data`: from collect(); only
    cases of the design without a result in `work` are written.
    """
    restored = 0
    for case in design.cases:
        if case.name not in data["case"].values:
            continue
        row = data.sel(case=case.name)
        for seed in case.seeds:
            file, at = result_file(work, case, seed), np.flatnonzero(row["seed"].values == seed)
            if file.exists() or not len(at) or str(row["status"].values[at[0]]) == "not run":
                continue
            file.parent.mkdir(parents=True, exist_ok=True)
            write_text(file, json.dumps(_result(case, row.isel(replicate=int(at[0]))), indent=1))
            restored += 1
    return restored


def _result(case: Case, row: xr.Dataset) -> dict[str, Any]:
    """Result of one case and replicate of the data set, as analysis.speed_error.jobs.run_case writes it."""
    values = dict(zip(row["observable"].values.tolist(), row["value"].values.tolist(), strict=True))
    values |= dict(zip(row["check_name"].values.tolist(), row["check"].values.tolist(), strict=True))
    status = str(row["status"].item())
    numbers = {name: float(row[name]) for name in ("wall_time", "yardstick", "time_step_over_limit")}
    whole = {name: int(row[name]) for name in ("seed", "grains", "steps") if np.isfinite(float(row[name]))}
    return {"case": case.name, "status": status, "values": {} if status else values, **numbers, **whole}


def cost(data: xr.Dataset) -> xr.DataArray:
    """Cost (case,): wall time divided by the yardstick, median over replicates."""
    return (data["wall_time"] / data["yardstick"]).median("replicate")
