"""The experiment on fabric and density: its statistics, and the stored tables."""

import json

import numpy as np
import pandas
import pytest
from scipy.stats import ttest_ind

from analysis.sand.fabric import FABRICS, PRESSURE, SHAPES, TOLERANCE, examined
from analysis.sand.fabric_table import DENSITIES, PLANNED, STORED, combination, effects, interactions, table_of
from analysis.sand.karlsruhe import RESULTS


@pytest.fixture(scope="module")
def rows():
    every = [json.loads(line) for line in STORED.read_text(encoding="utf-8").splitlines()]
    return [row for row in every if "failed" not in row]


def test_a_difference_of_two_groups_is_welchs():
    rng = np.random.default_rng(3)
    a, b = rng.normal(1.0, 1.0, 5), rng.normal(0.0, 3.0, 7)
    welch = ttest_ind(a, b, equal_var=False)
    mine = combination([(1.0, a), (-1.0, b)])
    assert mine["p"] == pytest.approx(welch.pvalue)
    interval = welch.confidence_interval()
    assert [mine["estimate"] - mine["within"], mine["estimate"] + mine["within"]] == pytest.approx([*interval])
    assert combination([(1.0, np.ones(3)), (-1.0, np.ones(3))]) == {"estimate": 0.0, "within": 0.0, "p": 1.0}
    assert np.isnan(combination([(1.0, a[:1]), (-1.0, b)])["within"])
    assert np.isnan(combination([(1.0, a[:0]), (-1.0, b)])["estimate"])


def test_the_interaction_is_that_of_logarithms_of_ratios():
    feature, sizes = PLANNED[0], {}
    rows = []
    for density in DENSITIES:
        for fabric in FABRICS:
            for seed in (1, 2):
                q = sizes.setdefault((density, fabric), 0.1 * (len(sizes) + 1)) * (1.0 + 0.01 * seed)
                rows.append({"shape": "rods", "density": density, "fabric": fabric, "seed": seed, feature: q})
    made = interactions(pandas.DataFrame(rows).assign(**dict.fromkeys(PLANNED[1:], 1.0)))
    first = made.query("feature == @feature and fabric == 'deposited'").iloc[0]
    expected = np.log(sizes["loose", "deposited"] / sizes["loose", "isotropic"])
    expected -= np.log(sizes["medium", "deposited"] / sizes["medium", "isotropic"])
    assert first["estimate"] == pytest.approx(expected)
    assert (made["p_holm"] >= made["p"]).all()


def test_stored_specimens_have_their_void_ratio_and_sign_of_fabric(rows):
    for row in rows:
        assert abs(row["e"] - SHAPES[row["shape"]][3][row["density"]]) <= TOLERANCE
        assert row["fabric"] == "isotropic" or (row["A"] > 0.0) == (row["fabric"] == "deposited")


@pytest.mark.parametrize("name, function", [("fabric_interactions", interactions), ("fabric_effects", effects)])
def test_stored_tests_give_the_stored_tables(rows, name, function):
    stored, made = pandas.read_csv(RESULTS / f"{name}.csv"), function(table_of(rows))
    numbers = made.select_dtypes("number").columns
    np.testing.assert_allclose(made[numbers], stored[numbers], rtol=1e-3, atol=1e-12)
    assert made.drop(columns=numbers).equals(stored.drop(columns=numbers))


def test_a_specimen_that_cannot_be_made_is_named(monkeypatch):
    for name, value in (("SHAPES", {"spheres": ("sphere", 0.1, 100, {"medium": 1.4})}), ("TRIALS", 1)):
        monkeypatch.setattr(f"analysis.sand.fabric.{name}", value)
    row = examined(("spheres", "medium", "isotropic", 1), 0.3)
    assert "no friction gives a void ratio of 1.4" in row["failed"] and PRESSURE == 200e3
