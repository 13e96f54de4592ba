"""Numbers with a 95 % interval from the scatter between tests.

The records of one test fluctuate together and count as one. Where there is a single test, the means of a few blocks of
its window stand for tests; that interval knows nothing of other specimens.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pandas
from scipy import stats

from analysis import intervals

BLOCKS = 5  # of the window of a single test


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number, the half-width of its interval (NaN: unknown), and the number of tests that it is made of."""

    value: float
    within: float
    n: int

    @property
    def matters(self) -> bool:
        """Whether the interval leaves out zero."""
        return bool(abs(self.value) > self.within)


NOTHING = Estimate(math.nan, math.nan, 0)


def jackknife(statistic: Callable[[np.ndarray], float], n: int, parameters: int = 1) -> Estimate:
    """The Estimate of `statistic(rows)`, rows an array of indices into n tests, by leaving out one test at a time.

    Of a mean it is the interval of Student's t. `parameters`: how many numbers the statistic fits at once; the
    degrees of freedom are n - parameters, and without any the width is NaN.
    """
    if n == 0:
        return NOTHING
    error = float(stats.sem(_deviations(statistic, n))) if n > 1 else math.nan
    return Estimate(float(statistic(np.arange(n))), intervals.student(error, n - parameters), n)


def two_samples(
    statistic: Callable[[pandas.DataFrame], float], first: pandas.DataFrame, second: pandas.DataFrame
) -> Estimate:
    """The Estimate of statistic(second) - statistic(first), two independent tables (Welch: unequal variances).

    A table of one row takes its scatter from the other.
    """
    n = len(first), len(second)
    if min(n) == 0:
        return NOTHING
    samples = (_deviations(lambda rows: statistic(one.iloc[rows]), len(one)) for one in (second, first))
    return Estimate(float(statistic(second) - statistic(first)), intervals.welch(*samples), sum(n))


def _deviations(statistic, n):
    """The pseudo-values of the jackknife (n,), less a constant: they scatter as n tests do; of a mean they are the
    deviations of the tests.
    """
    if n < 2:
        return np.zeros(n)
    every = np.arange(n)
    left_out = np.array([statistic(np.delete(every, k)) for k in every], dtype=float)
    return (n - 1) * (left_out.mean() - left_out)


def text(value: float, within: float = math.nan, digits: int = 3) -> str:
    """`0.938 ± 0.006`: as many digits as the half-width has two of; without it `digits` significant ones."""
    if not math.isfinite(value):
        return ""
    if not (math.isfinite(within) and within > 0.0):
        return f"{value:.{digits}g}"
    decimals = max(0, 1 - math.floor(math.log10(within)))
    return f"{value:.{decimals}f} ± {within:.{decimals}f}"
