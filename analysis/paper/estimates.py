"""Numbers with a 95 % interval from the scatter between specimens.

The records of one test are correlated and count as one observation, and tests of one specimen share its packing, so
specimens are counted. A single specimen has no interval.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pandas
from scipy import stats

from analysis.statistics import NOTHING, Tested, student, t_interval, welch

BLOCKS = 5  # blocks of the averaging window of a test


def jackknife(
    statistic: Callable[[np.ndarray], float], n: int, parameters: int = 1, clusters: Sequence[str] | None = None
) -> Tested:
    """Estimate of `statistic(rows)`, rows an array of indices into n tests, by leaving out one specimen at a time.

    For a mean of specimens tested once each this is the Student t interval. The statistic fits a number of `parameters`
    at once; `clusters` are the specimens of the tests (default: every test has its own). The degrees of freedom are
    specimens - parameters; width and p-value are NaN without degrees of freedom.
    """
    if n == 0:
        return NOTHING
    deviations = _deviations(statistic, n, clusters)
    error = float(stats.sem(deviations)) if len(deviations) > 1 else math.nan
    return Tested.of(float(statistic(np.arange(n))), error, len(deviations) - parameters, len(deviations))


def two_samples(
    statistic: Callable[[pandas.DataFrame], float], first: pandas.DataFrame, second: pandas.DataFrame
) -> Tested:
    """Estimate of statistic(second) - statistic(first), two independent tables (Welch: unequal variances).

    A table with one row is given the scatter of the other.
    """
    n = len(first), len(second)
    if min(n) == 0:
        return NOTHING

    def sample(table: pandas.DataFrame) -> np.ndarray:
        return _deviations(lambda rows: statistic(table.iloc[rows]), len(table), None)

    one, other = sample(first), sample(second)
    value = float(statistic(second) - statistic(first))
    if max(n) < 2 or np.ptp(one) == np.ptp(other) == 0.0:
        return Tested(value, welch(other, one), sum(n), math.nan)
    test = stats.ttest_ind(other, one, equal_var=min(n) == 1)
    return Tested.of(value, t_interval(test) / student(1.0, test.df), test.df, sum(n))


def difference_of_means(first: pandas.Series, second: pandas.Series) -> Tested:
    """Mean of `second` minus mean of `first`, two independent samples (Welch)."""
    return two_samples(lambda table: float(table.to_numpy().mean()), first.to_frame(), second.to_frame())


def _deviations(statistic: Callable[[np.ndarray], float], n: int, clusters: Sequence[str] | None) -> np.ndarray:
    """Pseudo-values of the jackknife (specimens,) up to a constant; for a mean, the deviations of the specimens."""
    codes = np.arange(n) if clusters is None else pandas.factorize(np.asarray(clusters))[0]
    count = int(codes.max()) + 1
    if count < 2:
        return np.zeros(count)
    left_out = np.array([statistic(np.flatnonzero(codes != k)) for k in range(count)], dtype=float)
    return (count - 1) * (left_out.mean() - left_out)


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
