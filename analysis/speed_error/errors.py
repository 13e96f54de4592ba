"""Errors relative to the reference, changes relative to the baseline, and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import pandas
import xarray as xr
from scipy import stats

from analysis.speed_error.design import BASELINE, PRESET
from analysis.speed_error.observables import OBSERVABLES
from analysis.speed_error.table import cost
from analysis.statistics import t_interval, welch

Tests: TypeAlias = Mapping[str, Any]  # the tests of one case: observables, `seed` and `grains`, each (replicate,)


def errors(data: xr.Dataset, timed: pandas.DataFrame) -> pandas.DataFrame:
    """Errors, changes and costs, a pandas.DataFrame with a row per case and observable.

    `data`: from analysis.speed_error.table.collect; `timed`: from analysis.speed_error.measures.settings. Columns:

    mean, scatter: mean and standard deviation over the replicates.
    error, error_within: mean minus the mean of the reference on the same path, relative to the latter if OBSERVABLES
        says so, and its 95 % half-width.
    one_run: expected error of a single test, sqrt(error^2 + scatter^2).
    change, change_within: mean difference from the baseline for the same specimens, and its 95 % half-width (paired).
    cost, over_standard: cost relative to the baseline of the same path, and to the standard settings; for the
        presets and the baseline the latter was measured directly.

    A half-width is NaN if there are fewer than two replicates.
    """
    costs, over_standard = cost(data).to_series(), timed.set_index("case")["over_standard"]
    cases = {str(case): _tests_of(data.sel(case=case)) for case in data["case"].values}
    rows = []
    for path in dict.fromkeys(data["path"].values.tolist()):
        some = data.isel(case=np.flatnonzero(data["path"].values == path))
        base, best = _case(some, BASELINE), _case(some, PRESET, "reference")
        baseline, reference = cases[base], cases[best]
        for k, case in enumerate(some["case"].values):
            over_base, tests = float(costs[case] / costs[base]), cases[case]
            for name, (label, _, relative) in OBSERVABLES.items():
                valid, scale = _valid(tests[name]), _scale(reference, name, relative)
                scatter = valid.std(ddof=1) if valid.size > 1 else np.nan
                error, error_within = _against(tests, reference, name)
                change, change_within = _mean_of(_pairs(tests, baseline, name))
                base_scale = _scale(baseline, name, relative)
                rows.append(
                    {
                        "path": path,
                        "case": case,
                        "factor": str(some["factor"].values[k]),
                        "level": str(some["level"].values[k]),
                        "observable": name,
                        "label": label,
                        "replicates": valid.size,
                        "number_of_grains": float(pandas.Series(tests["grains"]).mean()),
                        "mean": valid.mean() if valid.size else np.nan,
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


def _tests_of(case: xr.Dataset) -> Tests:
    """The tests of one case in arrays of numpy, because xarray takes a millisecond for each number."""
    values = zip(case["observable"].values.tolist(), case["value"].transpose("observable", ...).values, strict=True)
    return dict(values) | {name: case[name].values for name in ("seed", "grains")}


def _case(data: xr.Dataset, factor: str, level: str | None = None) -> str:
    """Name of the first case of a factor, and of a level if one is given."""
    at = data["factor"].values == factor
    if level is not None:
        at &= data["level"].values == level
    return str(data["case"].values[np.flatnonzero(at)[0]])


def _scale(case: Tests, name: str, relative: bool) -> float:
    """Value by which the differences of an observable are divided."""
    values = _valid(case[name])
    return abs(values.mean()) if relative and values.size else 1.0


def _valid(values: np.ndarray) -> np.ndarray:
    return values[np.isfinite(values)]


def _against(case: Tests, other: Tests, name: str) -> tuple[float, float]:
    """Mean difference of two cases and the half-width of its interval, NaN if unknown.

    The interval is paired if their specimens are the same, which removes the scatter of specimens; otherwise Welch's.
    """
    paired = _pairs(case, other, name)
    if paired.size:
        return _mean_of(paired)
    a, b = (_valid(tests[name]) for tests in (case, other))
    determined = min(a.size, b.size) > 1 and (np.ptp(a) > 0.0 or np.ptp(b) > 0.0)
    return (a.mean() - b.mean() if a.size and b.size else np.nan), welch(a, b) if determined else np.nan


def _pairs(case: Tests, other: Tests, name: str) -> np.ndarray:
    """Differences (pair,) of an observable between the tests of two cases on the same specimens."""
    return _valid((case[name] - other[name])[same_specimens(case, other)])


def same_specimens(case: Tests | xr.Dataset, other: Tests | xr.Dataset) -> np.ndarray:
    """Mask (replicate,) of the replicates of two cases that are tests of the same specimen."""
    same = [np.asarray(case[name]) == np.asarray(other[name]) for name in ("seed", "grains")]
    return same[0] & same[1] & (np.asarray(case["seed"]) > 0)


def _mean_of(differences: np.ndarray) -> tuple[float, float]:
    if differences.size < 2 or np.ptp(differences) == 0.0:
        return differences.mean() if differences.size else np.nan, np.nan
    return differences.mean(), t_interval(stats.ttest_1samp(differences, 0.0))


def front(costs: np.ndarray, errors_: np.ndarray) -> list[int]:
    """Indices of the Pareto front, cheapest first: no other point is both cheaper and more accurate."""
    order = np.lexsort((errors_, costs))
    indices, best = [], np.inf
    for k in order:
        if errors_[k] < best:
            indices.append(int(k))
            best = errors_[k]
    return indices
