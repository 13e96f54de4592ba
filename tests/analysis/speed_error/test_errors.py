"""The coverage of intervals, tests that have not run, and the Pareto front."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from analysis.speed_error.design import read_design
from analysis.speed_error.errors import front
from analysis.speed_error.table import collect
from analysis.statistics import welch


def test_intervals_contain_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(400):
        a, b = 1.0 + 0.1 * rng.normal(size=4), 1.2 + 0.03 * rng.normal(size=3)
        hits += abs(a.mean() - b.mean() + 0.2) < welch(a, b)
    assert 0.92 < hits / 400 < 0.99


def test_what_has_not_run_yet_says_so(tmp_path):
    data = collect(read_design("small"), tmp_path)
    assert (data["status"] == "not run").values[data["seed"].values > 0].all() and data["value"].isnull().all()


@given(points=st.lists(st.tuples(st.floats(0.1, 10), st.floats(1e-4, 1)), min_size=1, max_size=30))
def test_nothing_is_both_cheaper_and_nearer_than_a_point_of_the_front(points):
    costs, errors_ = np.array(points).T
    found = front(costs, errors_)
    for k in range(len(points)):
        beaten = ((costs <= costs[k]) & (errors_ < errors_[k])) | ((costs < costs[k]) & (errors_ <= errors_[k]))
        if k in found:
            assert not beaten.any()
    assert all(any(costs[f] <= c and errors_[f] <= e for f in found) for c, e in points)
