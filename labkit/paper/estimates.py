"""Numbers with a 95 % interval from the scatter between tests.

The records of one test fluctuate together and count as one. Where there is a single test, the means of a few blocks of
its window stand for tests; that interval knows nothing of other specimens.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
BLOCKS = 5  # of the window of a single test


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number, the half-width of its interval (NaN: unknown), and the number of tests that it is made of."""

    value: float
    within: float
    n: int

    @property
    def matters(self):
        """Whether the interval leaves out zero."""
        return bool(abs(self.value) > self.within)


NOTHING = Estimate(math.nan, math.nan, 0)


def jackknife(statistic, n, parameters=1):
    """The Estimate of `statistic(rows)`, rows an array of indices into n tests, by leaving out one test at a time.

    Of a mean it is the interval of Student's t. `parameters`: how many numbers the statistic fits at once; the
    degrees of freedom are n - parameters, and without any the width is NaN.
    """
    if n == 0:
        return NOTHING
    every = np.arange(n)
    value = float(statistic(every))
    return Estimate(value, _half_width(_standard_error(statistic, n), n - parameters), n)


def two_samples(statistic, first, second):
    """The Estimate of statistic(second) - statistic(first), two independent tables (Welch: unequal variances).

    `statistic`: a function of a table (pandas.DataFrame). A table of one row takes its scatter from the other.
    """
    n = len(first), len(second)
    if min(n) == 0:
        return NOTHING
    square = [_standard_error(lambda rows: statistic(one.iloc[rows]), len(one)) ** 2 for one in (first, second)]  # noqa: B023
    if n.count(1) == 1:
        single = n.index(1)
        square[single] = n[1 - single] * square[1 - single]
    total = sum(square)
    value = float(statistic(second) - statistic(first))
    if not total > 0.0:
        return Estimate(value, 0.0 if total == 0.0 else math.nan, sum(n))
    freedom = max(n) - 1 if 1 in n else total**2 / sum(s**2 / (k - 1) for s, k in zip(square, n))
    return Estimate(value, _half_width(math.sqrt(total), freedom), sum(n))


def _standard_error(statistic, n):
    if n < 2:
        return math.nan
    every = np.arange(n)
    left_out = np.array([statistic(np.delete(every, k)) for k in every], dtype=float)
    return math.sqrt((n - 1) / n * np.sum((left_out - left_out.mean()) ** 2))


def _half_width(error, freedom):
    return float(stats.t.ppf(0.5 * (1.0 + CONFIDENCE), freedom) * error) if freedom > 0 else math.nan


def text(value, within=math.nan, digits=3):
    """`0.938 ± 0.006`: as many digits as the half-width has two of; without it `digits` significant ones."""
    if not math.isfinite(value):
        return ""
    if not (math.isfinite(within) and within > 0.0):
        return f"{value:.{digits}g}"
    decimals = max(0, 1 - math.floor(math.log10(within)))
    return f"{value:.{decimals}f} ± {within:.{decimals}f}"
