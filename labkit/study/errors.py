"""Errors with their uncertainty: against the reference, and against the baseline with the same specimens."""

from __future__ import annotations

import numpy as np
import pandas
from scipy import stats

from labkit.study.design import BASELINE, PRESET
from labkit.study.observables import OBSERVABLES
from labkit.study.table import cost

CONFIDENCE = 0.95


def errors(data, timed):
    """A pandas.DataFrame, a row per case and observable, from the data set of labkit.study.table; `timed`: the table
    of labkit.study.measures.settings.

    mean, scatter: over the replicates, scatter being their standard deviation.
    error, error_within: mean less that of the reference on the same path, over that of the reference where
        OBSERVABLES says relative, and the half-width of its 95 % interval (Welch: unequal variances, few replicates).
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
                sound, ideal = _sound(values), _sound(reference["value"].sel(observable=name).values)
                scale = abs(ideal.mean()) if relative and ideal.size else 1.0
                scatter = sound.std(ddof=1) if sound.size > 1 else np.nan
                error = (sound.mean() - ideal.mean()) / scale if sound.size and ideal.size else np.nan
                change, change_within = _change(some.sel(case=case), baseline, name, relative)
                rows.append({
                    "path": path, "case": case, "factor": str(some["factor"].values[k]),
                    "level": str(some["level"].values[k]), "observable": name, "label": label,
                    "replicates": sound.size,
                    "number_of_grains": float(some["grains"].sel(case=case).mean()),
                    "mean": sound.mean() if sound.size else np.nan, "scatter": scatter / scale, "error": error,
                    "error_within": _welch(sound, ideal) / scale, "one_run": np.hypot(error, scatter / scale),
                    "change": change, "change_within": change_within,
                    "cost": over_base, "over_standard": over_standard.get(case, over_base * over_standard[base]),
                })  # fmt: skip
    return pandas.DataFrame(rows)


def _case(data, factor, level=None):
    at = data["factor"].values == factor
    if level is not None:
        at &= data["level"].values == level
    return data.isel(case=int(np.flatnonzero(at)[0]))


def _sound(values):
    return values[np.isfinite(values)]


def _welch(a, b):
    """Half-width of the interval of mean(a) - mean(b); NaN where it cannot be said."""
    if a.size < 2 or b.size < 2 or (np.ptp(a) == 0.0 and np.ptp(b) == 0.0):
        return np.nan
    interval = stats.ttest_ind(a, b, equal_var=False).confidence_interval(CONFIDENCE)
    return float(0.5 * (interval.high - interval.low))


def _change(case, baseline, name, relative):
    """Mean difference to the baseline and its half-width; NaN for other specimens than its."""
    same = (case["seed"] == baseline["seed"]) & (case["grains"] == baseline["grains"]) & (case["seed"] > 0)
    here, there = (x["value"].sel(observable=name).values[same.values] for x in (case, baseline))
    both = np.isfinite(here) & np.isfinite(there)
    if not both.any():
        return np.nan, np.nan
    difference = here[both] - there[both]
    scale = abs(there[both].mean()) if relative else 1.0
    if difference.size < 2 or np.ptp(difference) == 0.0:
        return difference.mean() / scale, np.nan
    interval = stats.ttest_1samp(difference, 0.0).confidence_interval(CONFIDENCE)
    return difference.mean() / scale, float(0.5 * (interval.high - interval.low)) / scale


def front(costs, errors_):
    """Indices of the Pareto front, cheapest first: nothing is both cheaper and nearer."""
    order = np.lexsort((errors_, costs))
    found, best = [], np.inf
    for k in order:
        if errors_[k] < best:
            found.append(int(k))
            best = errors_[k]
    return found
