"""Separate errors of C0 in p, q and q/p: bias and scatter in every test, and over independent specimens."""

from __future__ import annotations

import numpy as np
import pandas

from analysis.paper.ends import Runs
from analysis.paper.specimens import specimen_of
from analysis.statistics import adjusted, cluster_mean
from labkit.runs import SFF_PRESSURE

QUANTITIES = ("p", "q", "ratio")


def c0_errors(runs: Runs) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per test and quantity (p, q, ratio = q/p), over the records with p > 50 kPa.

    `bias` is the mean relative error with its sign, and `lowest` and `highest` are those of single records. q and q/p
    are judged where |q| >= 0.2 p; a test that is never sheared that far has no row for them.
    """
    rows = []
    for name, run in runs.items():
        judged = run.lab.mean_stress().values > SFF_PRESSURE
        errors = run.lab.sff_errors()
        for quantity in QUANTITIES:
            error = errors[quantity].values[judged].astype(float)
            error = error[np.isfinite(error)]
            if len(error):
                rms = float(np.sqrt(np.mean(error**2)))
                test = name, specimen_of(name), run.attrs["path"]
                rows.append((*test, quantity, len(error), error.mean(), rms, error.min(), error.max()))
    columns = ["run", "specimen", "path", "quantity", "records", "bias", "rms", "lowest", "highest"]
    return pandas.DataFrame(rows, columns=columns)


def c0_bias(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Bias over independent specimens, a pandas.DataFrame with a row per path (and `shear`) and quantity.

    `errors` is the table of c0_errors. `bias` and `within` are the mean over specimens with its 95 % half-width,
    `p_value` is that of the t test that the bias is zero, `corrected` for the number of rows (Holm), `rms` is the mean
    of the tests' values, and `low` counts tests with a negative bias.
    """
    rows = []
    shear = errors[errors["path"].isin(("cv", "cr", "cp"))].assign(path="shear")
    for (path, quantity), group in pandas.concat([shear, errors]).groupby(["path", "quantity"], sort=False):
        found = cluster_mean(group["bias"], group["specimen"])
        rows.append(
            {
                "path": path,
                "quantity": quantity,
                "tests": len(group),
                **found.columns("bias"),
                "rms": group["rms"].mean(),
                "least_rms": group["rms"].min(),
                "most_rms": group["rms"].max(),
                "low": int((group["bias"] < 0.0).sum()),
            }
        )
    columns = ["path", "quantity", "tests", "specimens", "bias", "within", "p_value"]
    table = pandas.DataFrame(rows, columns=[*columns, "rms", "least_rms", "most_rms", "low"])
    table.insert(7, "corrected", adjusted(table["p_value"].to_numpy(dtype=float)))
    return table
