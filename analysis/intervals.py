"""Half-widths of 95 % confidence intervals, from Student's t distribution."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import stats

CONFIDENCE = 0.95


def student(error: float, freedom: float) -> float:
    """Half-width for a number with this standard error and number of degrees of freedom; NaN for zero."""
    return float(stats.t.ppf(0.5 * (1.0 + CONFIDENCE), freedom) * error) if freedom > 0 else math.nan


def of_test(test: Any) -> float:
    """Half-width for the mean, or difference of means, from the result of a t-test of scipy.stats."""
    interval = test.confidence_interval(CONFIDENCE)
    return float(0.5 * (interval.high - interval.low))


def welch(a: np.ndarray, b: np.ndarray) -> float:
    """Half-width for mean(a) - mean(b), two independent samples (n,) and (m,) with unequal variances (Welch).

    A sample with one value is given the scatter of the other. 0 if both samples have zero scatter; NaN for two
    single values.
    """
    if max(a.size, b.size) < 2:
        return math.nan
    if np.ptp(a) == 0.0 and np.ptp(b) == 0.0:
        return 0.0
    return of_test(stats.ttest_ind(a, b, equal_var=min(a.size, b.size) == 1))
