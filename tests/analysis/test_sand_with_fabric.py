"""Grains with a fabric, calibrated on drained and undrained tests: specimens, points, stored tables."""

import numpy as np
import pandas
import pytest

import labkit as lk
from analysis.sand.karlsruhe import LIMITS, RESULTS
from analysis.sand.with_fabric import (
    DRAINED,
    FREE,
    LEFT,
    TRAINED,
    compressed,
    fabric_tests,
    lines_of,
    scene_of,
    share_at,
    sheared,
    undrained_points,
)
from analysis.sand.with_fabric_table import FILES, beside_the_first, predictions, scores
from labkit.plugins.laboratory_data import read_samples

PARAMETERS = {"friction": 0.5, "rolling ratio": 0.4, "log10 of E": 9.0, "log2 of g": 0.0, "shear": 0.005}


@pytest.mark.slow  # the kernel may be compiled in another process
def test_the_sign_of_the_shear_is_that_of_the_fabric_at_an_isotropic_stress():
    specimen = compressed(scene_of(PARAMETERS), 0.3, 200e3, 7)
    fabrics = {}
    for strain in (0.005, -0.005):
        snapshot = sheared(specimen, strain, 200e3).snapshot()
        stress = lk.love_stress(snapshot)
        np.testing.assert_allclose(stress, 200e3 * np.eye(3), atol=4e3)
        fabrics[strain] = lk.statistics(snapshot).contact_anisotropy[2, 2]
    assert fabrics[0.005] > fabrics[-0.005] + 0.1


def test_the_exponent_moves_the_density_between_the_limits():
    limits = [0.60, 0.65, 0.75, 0.85]
    e = {g: share_at(PARAMETERS | {"log2 of g": g}, 0.8, limits) for g in (-1.0, 0.0, 1.0)}
    assert e[-1.0] < e[0.0] < e[1.0]  # a larger exponent is looser, with more friction
    density = (LIMITS[1] - 0.8) / (LIMITS[1] - LIMITS[0])
    assert e[0.0] == pytest.approx(np.interp(0.85 - 0.25 * density, limits, (0.0, 0.1, 0.3, 1.0)))
    assert [share_at(PARAMETERS, at, limits) for at in LIMITS] == [0.0, 1.0]


def test_only_the_tests_trained_on_count():
    every = np.diag(fabric_tests((DRAINED, TRAINED, LEFT)).deviations)
    for trained, slices in (((DRAINED,), [slice(24, 30)]), ((TRAINED,), [slice(0, 24), slice(27, 30)])):
        expected = every.copy()
        for part in slices:
            expected[part] *= 1e6
        np.testing.assert_allclose(np.diag(fabric_tests(trained).deviations), expected)
    assert every[24:27] == pytest.approx([0.03**2, 0.03**2, 0.05**2])


def test_measured_features_are_the_last_points():
    tests = fabric_tests()
    assert tests.points(tests.measured)[24:] == pytest.approx(
        [0.4839, 1.3952, np.log(253.149 / 200.0), 0.3860, 0.9034, np.log(81.333 / 200.0)], abs=1e-3
    )
    assert undrained_points({"least": 0.0, "ratio": 1.0, "q": 0.1}, 200e3)[2] == pytest.approx(np.log(0.02))


def test_the_stored_draws_give_the_stored_predictions_and_scores():
    stored = {name: pandas.read_csv(RESULTS / f"with_fabric_{name}.csv") for name in ("predictions", "score")}
    misfit = pandas.read_csv(RESULTS / "with_fabric_posteriors.csv").query("parameter == 'misfit'")["50 %"].iloc[0]
    made = {"predictions": predictions(lines_of(FILES["draws"]), misfit), "score": scores(stored["predictions"])}
    for name, table in made.items():
        numbers = table.select_dtypes("number").columns
        np.testing.assert_allclose(table[numbers], stored[name][numbers], rtol=1e-2, atol=1e-3, err_msg=name)
        assert table.drop(columns=numbers).equals(stored[name][table.columns.drop(numbers)])


def test_the_untrained_test_is_compared_in_the_units_of_the_first_study():
    middle = np.array([0.0] * 5 + [0.386, 0.9034, np.log(81.33 / 200.0)])
    intervals = {"low": middle - 0.1, "middle": middle, "high": middle + 0.1}
    table = beside_the_first(intervals).set_index("feature")
    assert table["inside"].all() and not table["inside before"].any()
    q = table.loc["|q| at 3 % (kPa)"]
    assert q[["measured", "predicted"]].to_numpy(float) == pytest.approx([81.33, 81.33], rel=1e-3)
    spread = pandas.read_csv(RESULTS / "undrained.csv").query(
        "test.str.contains('extension') and feature == '|q| at 3 % (kPa)'"
    )
    assert q["score"] == pytest.approx((q["high"] - q["low"]) / spread["measured"].std(), rel=1e-3)


def test_stored_samples_and_posteriors_are_within_their_ranges():
    samples = read_samples(fabric_tests(), FILES["samples"])
    table = pandas.read_csv(RESULTS / "with_fabric_posteriors.csv").set_index("parameter")
    for name, (low, high) in FREE.items():
        assert all(low <= sample.parameters[name] <= high for sample in samples)
        assert (table.loc[name, ["5 %", "50 %", "95 %"]].to_numpy() >= low).all()
        assert (table.loc[name, ["5 %", "50 %", "95 %"]].to_numpy() <= high).all()
