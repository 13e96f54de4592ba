"""Numbers with a 95 % interval from the scatter between tests.

The records of one test are correlated and count as one observation. For a single test, the means of a few blocks of
its averaging window replace the tests; that interval does not include the scatter between specimens.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pandas
from scipy import stats

from analysis.statistics import NOTHING, Estimate, student, welch

BLOCKS = 5  # of the averaging window of a single test


def jackknife(statistic: Callable[[np.ndarray], float], n: int, parameters: int = 1) -> Estimate:
    """Estimate of `statistic(rows)`, rows an array of indices into n tests, by leaving out one test at a time.

    For a mean this is the Student t interval. `parameters`: number of parameters that the statistic fits at once; the
    degrees of freedom are n - parameters, and the width is NaN if there are none.
    """
    if n == 0:
        return NOTHING
    error = float(stats.sem(_deviations(statistic, n))) if n > 1 else math.nan
    return Estimate(float(statistic(np.arange(n))), student(error, n - parameters), n)


def two_samples(
    statistic: Callable[[pandas.DataFrame], float], first: pandas.DataFrame, second: pandas.DataFrame
) -> Estimate:
    """Estimate of statistic(second) - statistic(first), two independent tables (Welch: unequal variances).

    A table with one row is given the scatter of the other.
    """
    n = len(first), len(second)
    if min(n) == 0:
        return NOTHING

    def sample(table: pandas.DataFrame) -> np.ndarray:
        return _deviations(lambda rows: statistic(table.iloc[rows]), len(table))

    within = welch(sample(second), sample(first))
    return Estimate(float(statistic(second) - statistic(first)), within, sum(n))


def _deviations(statistic: Callable[[np.ndarray], float], n: int) -> np.ndarray:
    """Pseudo-values of the jackknife (n,) up to a constant; for a mean, the deviations of the tests.

    They scatter like n tests.
    """
    if n < 2:
        return np.zeros(n)
    every = np.arange(n)
    left_out = np.array([statistic(np.delete(every, k)) for k in every], dtype=float)
    return (n - 1) * (left_out.mean() - left_out)


def text(value: float, within: float = math.nan, digits: int = 3) -> str:
    """`0.9381 ± 0.0057`: rounded so that the half-width has two significant digits.

    Without a half-width the number has `digits` significant digits, or all digits before its decimal point.
    """
    if not math.isfinite(value):
        return ""
    if not (math.isfinite(within) and within > 0.0):
        return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"
    decimals = max(0, 1 - math.floor(math.log10(within)))
    return f"{value:.{decimals}f} ± {within:.{decimals}f}"
