"""The experiment on fabric and density: its statistics, and the stored tables."""

import json

import numpy as np
import pandas
import pytest

from analysis.sand.fabric import PRESSURE, SHAPES, TOLERANCE, examined
from analysis.sand.fabric_table import STORED, effects, interactions, table_of
from analysis.sand.karlsruhe import RESULTS


@pytest.fixture(scope="module")
def rows():
    every = [json.loads(line) for line in STORED.read_text(encoding="utf-8").splitlines()]
    return [row for row in every if "failed" not in row]


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
