"""Numbers with 95 % intervals from Student's t distribution; a specimen counts once."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pandas
from numpy.typing import ArrayLike
from scipy import stats

CONFIDENCE = 0.95
ALIKE = 1e-12  # relative scatter that is only rounding


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number, the half-width of its 95 % interval (NaN: unknown) and the number of independent values behind it."""

    value: float
    within: float
    n: int

    @property
    def matters(self) -> bool:
        """True if the interval excludes zero."""
        return bool(abs(self.value) > self.within)


@dataclasses.dataclass(frozen=True)
class Tested(Estimate):
    """An Estimate with the probability of the t test that it is zero (NaN: fewer than two specimens)."""

    p_value: float

    @classmethod
    def of(cls, value: float, error: float, freedom: float, n: int) -> Tested:
        """A number with this standard error and number of degrees of freedom; without them only the number is known."""
        known = freedom > 0 and error > 0.0
        p_value = 2.0 * float(stats.t.sf(abs(value) / error, freedom)) if known else math.nan
        return cls(value, student(error, freedom), n, p_value)

    def columns(self, name: str) -> dict[str, float]:
        """The number as columns of a table: specimens, `name`, within and p_value."""
        return {"specimens": self.n, name: self.value, "within": self.within, "p_value": self.p_value}


NOTHING = Tested(math.nan, math.nan, 0, math.nan)


def student(error: float, freedom: float) -> float:
    """Half-width for a number with this standard error and number of degrees of freedom; NaN for zero."""
    return float(stats.t.ppf(0.5 * (1.0 + CONFIDENCE), freedom) * error) if freedom > 0 else math.nan


def t_interval(test: Any) -> float:
    """Half-width for the mean, or difference of means, from the result of a t test of scipy.stats."""
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
    return t_interval(stats.ttest_ind(a, b, equal_var=min(a.size, b.size) == 1))


def cluster_mean(values: ArrayLike, clusters: ArrayLike | None = None) -> Tested:
    """Mean of the means of the clusters, and the t test that it is zero.

    `values` (n,) has one value per test and `clusters` (n,) its specimen; without clusters every test has its own
    specimen. NaN values are left out. The n of the result is the number of specimens.
    """
    means = _cluster_means(values, clusters)
    n = len(means)
    if n == 0:
        return NOTHING
    value = float(means.mean())
    if n == 1:
        return Tested(value, math.nan, 1, math.nan)
    if np.ptp(means) <= ALIKE * abs(value):
        return Tested(value, 0.0, n, 1.0 if value == 0.0 else 0.0)
    test = stats.ttest_1samp(means, 0.0)
    return Tested(value, t_interval(test), n, float(test.pvalue))


def paired_difference(
    table: pandas.DataFrame, value: str, by: str, first: object, second: object, cluster: str = "specimen"
) -> Tested:
    """Mean of (second - first) over the specimens that have both, and the paired t test that it is zero.

    The table has a row per test, with the columns `value`, `by` (whose entries `first` and `second` are compared) and
    `cluster`; several tests of one specimen and one kind are averaged first.
    """
    wide = table.pivot_table(index=cluster, columns=by, values=value, aggfunc="mean")
    if first not in wide or second not in wide:
        return NOTHING
    return cluster_mean((wide[second] - wide[first]).dropna().to_numpy())


def _cluster_means(values: ArrayLike, clusters: ArrayLike | None) -> np.ndarray:
    """Means of the finite values of each cluster (m,), clusters in order of first appearance."""
    numbers = np.asarray(values, dtype=float)
    labels = np.arange(numbers.size) if clusters is None else np.asarray(clusters)
    kept = np.isfinite(numbers)
    return pandas.Series(numbers[kept]).groupby(labels[kept], sort=False).mean().to_numpy()
