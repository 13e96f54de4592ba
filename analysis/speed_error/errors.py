"""Errors with their uncertainty: against the reference, and against the baseline with the same specimens."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr
from scipy import stats

from analysis import intervals
from analysis.speed_error.design import BASELINE, PRESET
from analysis.speed_error.observables import OBSERVABLES
from analysis.speed_error.table import cost


def errors(data: xr.Dataset, timed: pandas.DataFrame) -> pandas.DataFrame:
    """A pandas.DataFrame, a row per case and observable, from the data set of analysis.speed_error.table; `timed`: the
    table of analysis.speed_error.measures.settings.

    mean, scatter: over the replicates, scatter being their standard deviation.
    error, error_within: mean less that of the reference on the same path, over that of the reference where
        OBSERVABLES says relative, and the half-width of its 95 % interval.
    one_run: what one test is off by, sqrt(error^2 + scatter^2).
    change, change_within: mean difference to the baseline with the same specimens, and its 95 % half-width (paired).
    cost: over that of the baseline of the same path; over_standard: over that of the standard settings, which for
        these and the baseline was measured in turn.
    A NaN width: fewer than two replicates.
    """
    costs, over_standard = cost(data), timed.set_index("case")["over_standard"]
    rows = []
    for path in dict.fromkeys(data["path"].values.tolist()):
        some = data.isel(case=np.flatnonzero(data["path"].values == path))
        baseline, reference = _case(some, BASELINE), _case(some, PRESET, "reference")
        base = baseline["case"].item()
        for k, case in enumerate(some["case"].values):
            over_base = float(costs.sel(case=case) / costs.sel(case=base))
            for name, (label, _, relative) in OBSERVABLES.items():
                values = some["value"].sel(case=case, observable=name).values
                sound, scale = _sound(values), _scale(reference, name, relative)
                scatter = sound.std(ddof=1) if sound.size > 1 else np.nan
                error, error_within = _against(some.sel(case=case), reference, name)
                change, change_within = _mean_of(_pairs(some.sel(case=case), baseline, name))
                base_scale = _scale(baseline, name, relative)
                rows.append(
                    {
                        "path": path,
                        "case": case,
                        "factor": str(some["factor"].values[k]),
                        "level": str(some["level"].values[k]),
                        "observable": name,
                        "label": label,
                        "replicates": sound.size,
                        "number_of_grains": float(some["grains"].sel(case=case).mean()),
                        "mean": sound.mean() if sound.size else np.nan,
                        "scatter": scatter / scale,
                        "error": error / scale,
                        "error_within": error_within / scale,
                        "one_run": np.hypot(error, scatter) / scale,
                        "change": change / base_scale,
                        "change_within": change_within / base_scale,
                        "cost": over_base,
                        "over_standard": over_standard.get(case, over_base * over_standard[base]),
                    }
                )
    return pandas.DataFrame(rows)


def _case(data, factor, level=None):
    at = data["factor"].values == factor
    if level is not None:
        at &= data["level"].values == level
    return data.isel(case=int(np.flatnonzero(at)[0]))


def _scale(case, name, relative):
    """What the differences of an observable are divided by."""
    values = _sound(case["value"].sel(observable=name).values)
    return abs(values.mean()) if relative and values.size else 1.0


def _sound(values):
    return values[np.isfinite(values)]


def _against(case, other, name):
    """Mean difference of two cases and the half-width of its interval: pair by pair where their specimens are the same,
    which takes the scatter of specimens out, else Welch's. NaN where it cannot be said.
    """
    paired = _pairs(case, other, name)
    if paired.size:
        return _mean_of(paired)
    a, b = (_sound(x["value"].sel(observable=name).values) for x in (case, other))
    return (a.mean() - b.mean() if a.size and b.size else np.nan), _welch(a, b)


def _welch(a, b):
    """Half-width of the interval of mean(a) - mean(b), of unequal variances; NaN if it cannot be told."""
    if min(a.size, b.size) < 2 or (np.ptp(a) == 0.0 and np.ptp(b) == 0.0):
        return np.nan
    return intervals.welch(a, b)


def _pairs(case, other, name):
    """Differences (pair,) of an observable between tests of the same specimens; none where these are others."""
    difference = case["value"].sel(observable=name).values - other["value"].sel(observable=name).values
    return _sound(difference[same_specimens(case, other)])


def same_specimens(case: xr.Dataset, other: xr.Dataset) -> np.ndarray:
    """Which replicates of two cases are tests of the same specimen, (replicate,)."""
    return ((case["seed"] == other["seed"]) & (case["grains"] == other["grains"]) & (case["seed"] > 0)).values


def _mean_of(differences):
    if differences.size < 2 or np.ptp(differences) == 0.0:
        return differences.mean() if differences.size else np.nan, np.nan
    return differences.mean(), intervals.of_test(stats.ttest_1samp(differences, 0.0))


def front(costs: np.ndarray, errors_: np.ndarray) -> list[int]:
    """Indices of the Pareto front, cheapest first: nothing is both cheaper and nearer."""
    order = np.lexsort((errors_, costs))
    found, best = [], np.inf
    for k in order:
        if errors_[k] < best:
            found.append(int(k))
            best = errors_[k]
    return found
