"""Rods against spheres: contributions in a real snapshot, planted differences and their sentences, the page."""

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.shape.matching import matched
from analysis.shape.study import (
    GROUPS,
    LIKE,
    PARTS,
    STUDY,
    TESTS,
    differences,
    errors_by_strain,
    of_snapshot,
    outcome,
    window_means,
)

pytestmark = pytest.mark.long


def planted(**shift):
    """Four specimens of each group; `shift` is the excess of the spheres, by name."""
    rng = np.random.default_rng(3)
    names = [*LIKE, "M", "e", "p", "C0 p", "C0 q", *(f"{part} {c}" for part in PARTS for c in ("p", "q"))]
    rows = []
    for group in GROUPS:
        for test in TESTS:
            for seed in range(4):
                for strain in (0.0, 0.2, 0.25, 0.3):
                    values = {name: 1.0 + 1e-4 * rng.normal() for name in names}
                    values |= {name: values[name] + change * (group == "spheres") for name, change in shift.items()}
                    row = {"test": test, "group": group, "seed": seed, "strain": strain, **values}
                    rows.append(row | {"inertial_number": 2e-4, "inertial_in_window": 1e-4, "energy_balance": 1e-3})
    return pandas.DataFrame(rows)


def test_planted_differences_are_found_and_none_is_invented():
    found = differences(window_means(planted(Z=-0.3, A=0.1, **{"sizes q": 0.05}))).set_index("quantity")
    assert found["difference"].loc[["Z", "A", "sizes q"]].to_numpy() == pytest.approx([-0.3, 0.1, -0.05], abs=2e-3)
    assert found.loc["Z", "outcome"] == "outside" and found.loc["A", "outcome"] == "not resolved"
    assert found.loc["sizes q", "corrected"] < 1e-6
    assert (found["outcome"].drop(["Z", "A", "sizes q"]) == "inside").all()
    assert outcome(0.0, 0.001, 0.03, 3) == "not resolved"  # too few specimens to call anything equal


def test_an_error_that_grows_with_strain_is_given_by_strain():
    data = planted()
    data["C0 q"] = 0.5 * data["strain"] + 1e-4 * data["seed"]
    found = errors_by_strain(data).set_index(["test", "strain"])
    for test in TESTS:
        assert found.loc[[(test, "20 %"), (test, "30 %"), (test, "slope")], "q"].to_numpy() == pytest.approx(
            [10.015, 15.015, 5.0]
        )
        assert found.loc[(test, "slope"), "q_within"] < 1e-6 < 0.01 < found.loc[(test, "30 %"), "q_within"]


def test_only_rods_have_contact_vectors_that_are_not_along_the_normals():
    numbers = {}
    for shape, rolling in (("sphere", lk.Scene.rolling_friction), ("rod aspect_ratio=1.5", 0.0)):
        recipe = lk.Recipe(void_ratio=0.5, grains=100, shape=shape, step1_rolling_friction=rolling)
        state = lk.make_specimen(recipe, lk.Scene(rolling_friction=rolling), progress=False)
        numbers[shape] = of_snapshot(state.snapshot())
    spheres, rods = numbers.values()
    assert abs(spheres["directions p"]) < 1e-9 < 1e-3 < abs(rods["directions p"])
    assert rods["Z"] > spheres["Z"]


def test_the_page_says_the_sentences_of_the_plan(tmp_path):
    planted(Z=-0.3).to_csv(tmp_path / STUDY.data, index=False)
    rows = [("rods", 0.0, 0.7), ("spheres", 0.1, 0.6), ("spheres", 0.2, 0.8)]
    matching = pandas.DataFrame([dict(zip(("group", "rolling_friction", "M"), row, strict=True)) for row in rows])
    assert matched(matching) == pytest.approx(0.15)
    matching.assign(seed=91).to_csv(tmp_path / "matching.csv", index=False)
    STUDY.write(tmp_path, "a command", lambda done, text: None)
    page = (tmp_path / "README.md").read_text()
    assert "off by 100.0 ± 0.0 %" in page and "does not reproduce it" in page and "shape adds at most" in page
