"""Intervals: Student's for a mean, Welch's for two samples, and the scatter for a fit."""

import numpy as np
import pandas
import pytest
from scipy import stats

from analysis.markdown import text
from analysis.statistics import jackknife, two_samples


def test_the_interval_of_a_mean_is_students():
    values = np.random.default_rng(0).normal(3.0, 0.2, 7)
    found = jackknife(lambda rows: values[rows].mean(), 7)
    interval = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert found.value == pytest.approx(values.mean())
    assert found.within == pytest.approx(0.5 * (interval.high - interval.low))


def test_the_interval_of_a_difference_is_welchs():
    rng = np.random.default_rng(1)
    first, second = (pandas.DataFrame({"x": rng.normal(size=n)}) for n in (4, 9))
    found = two_samples(lambda table: table["x"].mean(), first, second)
    interval = stats.ttest_ind(second["x"], first["x"], equal_var=False).confidence_interval(0.95)
    assert found.value == pytest.approx(second["x"].mean() - first["x"].mean())
    assert found.within == pytest.approx(0.5 * (interval.high - interval.low))


def test_a_single_test_takes_its_scatter_from_the_others():
    several, single = pandas.DataFrame({"x": [1.0, 2.0, 3.0]}), pandas.DataFrame({"x": [5.0]})
    found = two_samples(lambda table: table["x"].mean(), several, single)
    assert found.value == 3.0
    assert found.within == pytest.approx(stats.t.ppf(0.975, 2) * np.sqrt(1.0 + 1.0 / 3.0))


def test_intervals_of_a_slope_contain_the_truth():
    rng = np.random.default_rng(2)
    x, inside = np.linspace(0.0, 1.0, 12), 0
    for _ in range(100):
        y = 2.0 * x + rng.normal(0.0, 0.1, 12)
        slope = jackknife(lambda rows, y=y: np.polyfit(x[rows], y[rows], 1)[0], 12, parameters=2)
        inside += abs(slope.value - 2.0) <= slope.within
    assert inside >= 90


def test_too_few_tests_have_no_interval():
    assert np.isnan(jackknife(lambda rows: 1.0, 1).within)
    assert np.isnan(jackknife(lambda rows: 1.0, 0).value)
    assert np.isnan(jackknife(lambda rows: float(len(rows)), 3, parameters=3).within)


def test_a_number_has_the_digits_of_its_interval():
    assert text(0.93812, 0.00571) == "0.9381 ± 0.0057"
    assert text(0.93812) == "0.938" and text(14905.0) == "14905"
    assert text(13.2, 2.46) == "13.2 ± 2.5"
    assert text(float("nan")) == ""
