"""Half-widths of 95 % intervals, of Student's t."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import stats

CONFIDENCE = 0.95


def student(error: float, freedom: float) -> float:
    """Of a number with this standard error and so many degrees of freedom; NaN without any."""
    return float(stats.t.ppf(0.5 * (1.0 + CONFIDENCE), freedom) * error) if freedom > 0 else math.nan


def of_test(test: Any) -> float:
    """Of the mean, or of the difference of means, that a t-test of scipy.stats is about."""
    interval = test.confidence_interval(CONFIDENCE)
    return float(0.5 * (interval.high - interval.low))


def welch(a: np.ndarray, b: np.ndarray) -> float:
    """Of mean(a) - mean(b), two independent samples (n,) and (m,) of unequal variances (Welch).

    A sample of one value takes its scatter from the other. 0 if neither scatters; NaN for two single values.
    """
    if max(a.size, b.size) < 2:
        return math.nan
    if np.ptp(a) == 0.0 and np.ptp(b) == 0.0:
        return 0.0
    return of_test(stats.ttest_ind(a, b, equal_var=min(a.size, b.size) == 1))
