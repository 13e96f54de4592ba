"""Errors and intervals of results drawn with known means and scatter; the Pareto front."""

import json

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.speed_error.design import BASELINE, PRESET, Case, Design
from analysis.speed_error.errors import errors, front
from analysis.speed_error.observables import CHECKS, OBSERVABLES
from analysis.speed_error.table import collect, cost
from analysis.statistics import welch

SEEDS = (1, 2, 3, 4, 5)
DESIGN = Design(
    (
        Case(BASELINE, "base", SEEDS, 1000),
        Case("rate", 50.0, SEEDS, 1000),
        Case("grains", 4000, SEEDS, 4000),
        Case(PRESET, "reference", SEEDS, 14000),
    ),
    (),
)

TIMED = pandas.DataFrame({"case": ["cp_baseline=base", "cp_settings=reference"], "over_standard": [0.07, 3.0]})


@pytest.fixture
def written(tmp_path):
    """A function that writes results with a given mean for each case and a scatter common to each seed."""

    def write(means, shared=0.02, own=0.002):
        rng = np.random.default_rng(5)
        (tmp_path / "results").mkdir(exist_ok=True)
        of_seed = {(case.grains, seed): rng.normal() for case in DESIGN.cases for seed in SEEDS}
        for case, mean in zip(DESIGN.cases, means, strict=True):
            for seed in SEEDS:
                value = mean * (1.0 + shared * of_seed[case.grains, seed] + own * rng.normal())
                result = {
                    "case": case.name,
                    "seed": seed,
                    "grains": case.grains,
                    "status": "",
                    "wall_time": 2.0 * mean,
                    "yardstick": 0.5,
                    "steps": 1000,
                    "time_step_over_limit": 0.5,
                    "values": dict.fromkeys([*OBSERVABLES, *CHECKS], value),
                }
                (tmp_path / "results" / f"{case.name}_{seed}.json").write_text(json.dumps(result))
        return collect(DESIGN, tmp_path)

    return write


def row(table, factor):
    return table[(table["factor"] == factor) & (table["observable"] == "ratio_peak")].iloc[0]


def test_a_difference_is_told_from_scatter_when_it_is_larger_and_only_then(written):
    data = written((1.0, 1.01, 1.0, 1.3))
    table = errors(data, TIMED)
    rate, grains = row(table, "rate"), row(table, "grains")
    assert rate["change"] == pytest.approx(0.01, abs=0.003) and rate["change_within"] < 0.005  # paired: 1 % is detected
    assert rate["error"] == pytest.approx(1.01 / 1.3 - 1, abs=0.03) and rate["error_within"] > 0.01
    assert np.isnan(grains["change"])  # other specimens
    assert abs(row(table, BASELINE)["change"]) == 0.0
    reference = row(table, PRESET)
    assert reference["error"] == 0.0 and reference["one_run"] == pytest.approx(reference["scatter"])
    np.testing.assert_allclose(cost(data).values, [4.0, 4.04, 4.0, 5.2])
    assert rate["cost"] == pytest.approx(1.01) and rate["over_standard"] == pytest.approx(0.0707)
    assert reference["over_standard"] == 3.0  # measured in turn


def test_the_reference_with_the_same_specimens_is_taken_pair_by_pair(tmp_path):
    rng = np.random.default_rng(2)
    (tmp_path / "results").mkdir()
    cases = (DESIGN.cases[0], *(Case(PRESET, level, SEEDS, 14000) for level in ("standard", "reference")))
    of_seed = {seed: rng.normal() for seed in SEEDS}
    for case, mean in zip(cases, (1.0, 1.005, 1.0), strict=True):
        for seed in SEEDS:
            value = mean * (1.0 + 0.05 * of_seed[seed] + 1e-3 * rng.normal())
            known = dict.fromkeys([*OBSERVABLES, *CHECKS], value)
            result = {"case": case.name, "seed": seed, "grains": case.grains, "status": "", "values": known}
            (tmp_path / "results" / f"{case.name}_{seed}.json").write_text(json.dumps(result))
    table = errors(collect(Design(cases, ()), tmp_path), TIMED)
    standard = table[(table["level"] == "standard") & (table["observable"] == "ratio_peak")].iloc[0]
    assert standard["error"] == pytest.approx(0.005, abs=0.002) and standard["error_within"] < 0.003
    assert standard["scatter"] > 0.02


def test_intervals_contain_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(400):
        a, b = 1.0 + 0.1 * rng.normal(size=4), 1.2 + 0.03 * rng.normal(size=3)
        hits += abs(a.mean() - b.mean() + 0.2) < welch(a, b)
    assert 0.92 < hits / 400 < 0.99


def test_what_has_not_run_yet_says_so(written, tmp_path):
    written((1.0, 1.0, 1.0, 1.0))
    next((tmp_path / "results").glob("cp_rate*_2.json")).unlink()
    data = collect(DESIGN, tmp_path)
    case = data.sel(case="cp_rate=50.0")
    assert case["status"].values.tolist() == ["", "not run", "", "", ""]
    assert row(errors(data, TIMED), "rate")["replicates"] == 4


@given(points=st.lists(st.tuples(st.floats(0.1, 10), st.floats(1e-4, 1)), min_size=1, max_size=30))
def test_nothing_is_both_cheaper_and_nearer_than_a_point_of_the_front(points):
    costs, errors_ = np.array(points).T
    found = front(costs, errors_)
    for k in range(len(points)):
        beaten = ((costs <= costs[k]) & (errors_ < errors_[k])) | ((costs < costs[k]) & (errors_ <= errors_[k]))
        if k in found:
            assert not beaten.any()
    assert all(any(costs[f] <= c and errors_[f] <= e for f in found) for c, e in points)
