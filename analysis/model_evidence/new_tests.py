"""The models on tests used neither to calibrate nor to choose them: those of results/critical_state."""

from __future__ import annotations

import json

import numpy as np
import pandas
import xarray as xr

from analysis.critical_state.ends import packing
from analysis.critical_state.questions import direction
from analysis.model_evidence.calibrations import AMENDED, CALIBRATED, FROM_Z_AND_A, TABLE_2, Calibrations
from analysis.model_evidence.errors import QUANTITIES, combined, errors_of_models, judged
from analysis.paper.ends import Runs

STRAIN = 0.4  # seeds of the paper's tests, to which the models were fitted
NOT_FITTED = "cyclic_cp"  # no calibration uses cyclic tests: the fits without them are fits to all other tests
DIRECTIONS = ("compression", "extension")
COMPARED = ((CALIBRATED, TABLE_2), (AMENDED, CALIBRATED), (FROM_Z_AND_A, CALIBRATED))


def new_tests(data: xr.Dataset, strain: float = STRAIN) -> Runs:
    """Axisymmetric tests with the paper's stiffness up to a strain, name -> run; data: of ./lab critical-state."""
    return {
        str(name): _run(data.sel(run=name), strain)
        for name, test in zip(data["run"].values, data["test"].values, strict=True)
        if direction(str(test)) in DIRECTIONS and "series" not in str(test)
    }


def _run(one: xr.Dataset, strain: float) -> xr.Dataset:
    """The records of a test up to a strain, as labkit.open_run has them."""
    parameters = json.loads(str(one["path_parameters"].values))
    parameters["strain"] = float(np.copysign(strain, parameters["strain"]))
    run = one.isel(point=(one["accumulated_strain"] <= strain * (1.0 + 1e-6)).values).rename(point="time")
    run = run.drop_vars(["run", "test", "specimen", "path", "path_parameters"]).astype("f8")
    run["axial_strain"] = run["strain"][:, 2, 2].drop_vars(["i", "j"])
    attrs = {"path": str(one["path"].values), "path_parameters": json.dumps(parameters)}
    return run.assign_attrs(attrs)


def new_errors(runs: Runs, calibrations: Calibrations) -> pandas.DataFrame:
    """Errors of every model in every new test, a row per test and model, as those of analysis.model_evidence.errors.

    `path` is the name of the test in its campaign, `direction` compression or extension.
    """
    table = errors_of_models(runs, calibrations, NOT_FITTED)
    names = table["run"].str.partition("-")
    table["path"] = names[0]
    table.insert(1, "specimen", [packing(specimen) for specimen in names[2]])
    table.insert(3, "direction", [direction(test) for test in names[0]])
    return table


def new_combined(errors: pandas.DataFrame) -> pandas.DataFrame:
    """`combined` of the tests in compression, and of those in extension: a column `direction` and a row per pair."""
    parts = {name: errors[errors["direction"] == name] for name in DIRECTIONS}
    return pandas.concat([combined(part).assign(direction=name) for name, part in parts.items() if len(part)])


def new_parts(errors: pandas.DataFrame) -> pandas.DataFrame:
    """`combined` of parts of the tests in compression, a row per part and pair of COMPARED, corrected over all (Holm).

    part: a path, a quantity, or `by seed`, where the specimens of one seed count once.
    """
    own = errors[errors["direction"] == "compression"]
    parts = {f"{path.upper()} tests": own[own["path"] == path] for path in ("cv", "cp", "cr")}
    for quantity in QUANTITIES:
        others = [other for other in QUANTITIES if other != quantity]
        parts[f"error of {quantity[0]}"] = own.assign(**dict.fromkeys(others, np.nan))
    parts["by seed"] = own.assign(specimen=own["specimen"].str.rpartition("-")[2])
    table = pandas.concat([combined(part).assign(part=name) for name, part in parts.items()], ignore_index=True)
    table = table[[pair in COMPARED for pair in zip(table["model"], table["against"], strict=True)]]
    return judged(table, table["ratio"] < 1.0)
