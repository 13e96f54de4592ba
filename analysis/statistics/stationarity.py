"""Stationarity: the slope of a quantity over the last part of a test, in one test and over independent specimens.

Within one test the slope and its interval are those of labkit.results.slope; with 100 records and correlations of 0 to
0.95 the usual estimate of Newey and West contains the true slope in 0.54 to 0.86 of all cases. Over specimens the
interval follows from the scatter of their slopes and needs no assumption on the records.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas
from numpy.typing import ArrayLike

from analysis.statistics import NOTHING, Method, Tested, adjusted, cluster_mean, with_verdict
from labkit.results import slope

PER = 0.1  # slopes are given per this much strain


def slope_of(strain: ArrayLike, values: ArrayLike, per: float = PER) -> Tested:
    """Slope of values (n,) against strain (n,), evenly spaced, per `per` of strain, with the interval described above.

    n of the result is the number of independent records, rounded down and at least 1. All NaN for fewer than 8 records.
    """
    found = slope(strain, values, per)
    if not np.isfinite(found.value):
        return NOTHING
    if found.error == 0.0:
        return Tested(0.0, 0.0, int(found.independent), 1.0)
    return Tested.of(found.value, found.error, found.freedom, max(int(found.independent), 1))


def slope_table(
    records: pandas.DataFrame,
    quantities: Sequence[str],
    begin: float,
    end: float = math.inf,
    by: Sequence[str] = (),
    per: float = PER,
) -> pandas.DataFrame:
    """Slopes over begin <= strain <= end, a pandas.DataFrame with a row per run and quantity.

    records: a row per record, with the columns `run`, `specimen`, `strain`, those named in `by` (constant in a run) and
    the quantities. Columns: run, specimen, those of `by`, quantity, mean, slope (per `per` of strain), within, p_value,
    independent (number of independent records in the window).
    """
    inside = records[(records["strain"] >= begin) & (records["strain"] <= end)]
    rows = []
    for run, test in inside.groupby("run", sort=False):
        kept = {name: test[name].iloc[0] for name in ("specimen", *by)}
        for quantity in quantities:
            found = slope_of(test["strain"], test[quantity], per)
            rows.append(
                {
                    "run": run,
                    **kept,
                    "quantity": quantity,
                    "mean": float(test[quantity].mean()),
                    **found.columns("slope"),
                    "independent": found.n,
                }
            )
    columns = ["run", "specimen", *by, "quantity", "mean", "slope", "within", "p_value", "independent"]
    return pandas.DataFrame(rows, columns=columns)


RELATIVE = 0.01  # slope that matters, relative to the mean, per PER of strain
STATIONARY = {"differs": "drifts", "agrees": "stationary", "not resolved": "not resolved"}


def stationarity_table(
    slopes: pandas.DataFrame, by: Sequence[str] = (), judged: Mapping[str, float] | None = None, method: Method = "holm"
) -> pandas.DataFrame:
    """Slopes over independent specimens, a pandas.DataFrame with a row per combination of `by` and quantity.

    `slopes` is the result of slope_table; `judged` is the smallest slope that matters for a quantity (default: RELATIVE
    of its mean). The slopes of one specimen are averaged, so a specimen counts once. The columns are those of `by`,
    quantity, tests, specimens, mean, slope, within, p_value (t test that the mean slope is zero), corrected (for the
    number of rows), judged, passed (tests whose own interval contains zero) and verdict. A quantity may be called
    critical only if the verdict is `stationary`: the whole interval is within `judged`. It `drifts` if it is not
    stationary and the slope is resolved.
    """
    limits = judged or {}
    rows = []
    for key, group in slopes.groupby([*by, "quantity"], sort=False):
        kept = group[np.isfinite(group["slope"])]
        found = cluster_mean(kept["slope"], kept["specimen"])
        mean = cluster_mean(kept["mean"], kept["specimen"]).value
        rows.append(
            {
                **dict(zip((*by, "quantity"), key, strict=True)),
                "tests": len(kept),
                "mean": mean,
                **found.columns("slope"),
                "judged": limits.get(str(key[-1]), RELATIVE * abs(mean)),
                "passed": int((kept["slope"].abs() <= kept["within"]).sum()),
            }
        )
    columns = ["quantity", "tests", "specimens", "mean", "slope", "within", "p_value", "corrected", "judged", "passed"]
    table = pandas.DataFrame(rows, columns=[*by, *columns])
    table["corrected"] = adjusted(table["p_value"], method)
    table = with_verdict(table, "slope")
    return table.assign(verdict=table["verdict"].map(STATIONARY))
