"""Statistics of independent specimens: means, differences, stationarity, "one line", and many comparisons at once.

The records of one test are correlated and count as one observation, and tests of one specimen share its packing. In
every function the specimen (the cluster) is the unit that counts; a single specimen has no interval. Here are numbers
with 95 % intervals from Student's t distribution, corrections for the number of comparisons, and verdicts that
distinguish agreement from a lack of resolution; `stationarity` has the slope over the last part of a test, `one_line`
the test that all groups share a line.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import pandas
from numpy.typing import ArrayLike
from scipy import stats
from statsmodels.stats.multitest import multipletests

CONFIDENCE = 0.95
ALIKE = 1e-12  # relative scatter that is only rounding
SIGNIFICANT = 0.05  # error rate of a family of comparisons

Method = Literal["holm", "fdr_bh"]


@dataclasses.dataclass(frozen=True)
class Tested:
    """A number, the half-width of its 95 % interval (NaN: unknown) and the number of independent values behind it.

    Also the probability of the t test that the number is zero (NaN: fewer than two specimens).
    """

    value: float
    within: float
    n: int
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
    numbers = np.asarray(values, dtype=float)
    labels = np.arange(numbers.size) if clusters is None else np.asarray(clusters)
    kept = np.isfinite(numbers)
    means = pandas.Series(numbers[kept]).groupby(labels[kept], sort=False).mean().to_numpy()
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


def _deviations(statistic: Callable[[np.ndarray], float], n: int, clusters: Sequence[str] | None) -> np.ndarray:
    """Pseudo-values of the jackknife (specimens,) up to a constant; for a mean, the deviations of the specimens."""
    codes = np.arange(n) if clusters is None else pandas.factorize(np.asarray(clusters))[0]
    count = int(codes.max()) + 1
    if count < 2:
        return np.zeros(count)
    left_out = np.array([statistic(np.flatnonzero(codes != k)) for k in range(count)], dtype=float)
    return (count - 1) * (left_out.mean() - left_out)


def adjusted(p_values: ArrayLike, method: Method = "holm") -> np.ndarray:
    """p-values (n,) corrected for their number; NaN stays NaN and is not counted.

    `holm` (Holm 1979) controls the probability of a single false finding, `fdr_bh` (Benjamini & Hochberg 1995) the
    share of false ones among all findings.
    """
    p = np.asarray(p_values, dtype=float)
    tested = np.isfinite(p)
    corrected = np.full(p.shape, np.nan)
    if tested.any():
        corrected[tested] = multipletests(p[tested], alpha=SIGNIFICANT, method=method)[1]
    return corrected


def adjusted_once(table: pandas.DataFrame, by: Sequence[str]) -> np.ndarray:
    """`p_value` of each row, corrected (Holm) for the number of tests; rows with the same `by` belong to one test."""
    asked = table.drop_duplicates(list(by)).set_index(list(by))["p_value"]
    corrected = pandas.Series(adjusted(asked), asked.index)
    return corrected.loc[pandas.MultiIndex.from_frame(table[list(by)])].to_numpy()


def corrected(rows: Sequence[Any], columns: Sequence[str] | None = None, method: Method = "holm") -> pandas.DataFrame:
    """A pandas.DataFrame of rows with a `p_value`, and the column `corrected`: for the number of rows."""
    table = pandas.DataFrame(rows, columns=columns)
    return table.assign(corrected=adjusted(table["p_value"].to_numpy(dtype=float), method))


def with_verdict(table: pandas.DataFrame, name: str, within: str = "within") -> pandas.DataFrame:
    """The table with the column `verdict` of the number `name`, from its columns `within`, judged and corrected."""
    verdicts = [verdict(*row) for row in table[[name, within, "judged", "corrected"]].to_numpy(dtype=float)]
    return table.assign(verdict=verdicts)


def in_bold(rows: pandas.DataFrame) -> pandas.DataFrame:
    """The rows of a table with the column `bold`: `**` if the difference from zero is resolved."""
    return rows.assign(bold=["**" * (p_value <= SIGNIFICANT) for p_value in rows["corrected"]])


def verdict(difference: float, within: float, judged: float, p_value: float = math.nan, rounding: float = 0.0) -> str:
    """`differs`, `agrees` or `not resolved`.

    A number `agrees` if the whole interval is within `judged` of zero (an equivalence test). It `differs` if it does
    not agree, the interval, widened by the rounding, excludes zero, and the corrected p-value (if given) is at most
    SIGNIFICANT. Everything else, including an unknown interval, is `not resolved`.

    Args:
        difference: Our value minus the reference.
        within: Half-width of its 95 % interval.
        judged: Smallest difference that would matter.
        p_value: p-value corrected for the number of comparisons, or NaN if there is only one.
        rounding: Half a unit of the last printed digit of the reference.
    """
    if not (math.isfinite(difference) and math.isfinite(within)):
        return "not resolved"
    if abs(difference) + within <= judged:
        return "agrees"
    return "differs" if abs(difference) > within + rounding and not p_value > SIGNIFICANT else "not resolved"
