import json

import numpy as np
import pandas
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("emcee")

from analysis.sand.karlsruhe import DRAWS, OTHERS, RESULTS, USED, compare, grain_tests, half_width, prediction
from analysis.sand.score import scored
from analysis.sand.undrained import MEASURED
from analysis.sand.undrained import compare as compare_undrained
from analysis.sand.undrained import features as undrained_features
from labkit.plugins.laboratory_data import posterior_of, read_samples


def test_features_of_an_undrained_test_count_extension_as_compression():
    strain, p, q = np.linspace(0.0, -0.03, 31), np.linspace(100e3, 50e3, 31), np.linspace(0.0, -60e3, 31)
    found = undrained_features({"strain": strain, "p": p, "q": q})
    assert list(found.values()) == pytest.approx([0.5, 1.2, 59.4])
    assert undrained_features({"strain": strain, "p": p, "q": q, "cycles": [4.5]}) == {"cycles to r_u = 0.95": 4.5}
    without_load = {"strain": [0.0, 0.01, 0.03], "p": [1e5, 6e3, 4e3], "q": [0.0, 6e3, 8e3]}
    assert undrained_features(without_load)["largest |q/p|"] == pytest.approx(1.0)


@pytest.mark.parametrize("scatter", [0.0, 0.5, 5.0])
def test_an_interval_from_four_draws_contains_nine_of_ten_further_draws(scatter):
    rng, trials = np.random.default_rng(5), 4000
    further = rng.normal(size=trials) + scatter * rng.normal(size=trials)
    inside = [prediction(value, rng.normal(size=DRAWS), scatter)["inside"] for value in further]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.015)  # 1.645 without Student's factor: 0.76 for scatter = 0
    assert half_width([(4.0, 3)]) == pytest.approx(2.0 * 2.3534, rel=1e-4)


def test_the_stored_undrained_predictions_give_the_stored_table():
    draws = [json.loads(line) for line in (RESULTS / "undrained.jsonl").read_text().splitlines()]
    stored = pandas.read_csv(RESULTS / "undrained.csv")
    misfit = pandas.read_csv(RESULTS / "posterior.csv", index_col=0).loc["misfit", "50 %"]
    table = compare_undrained(json.loads(MEASURED.read_text()), draws, misfit)
    assert (table["inside"] == stored["inside"]).all()
    np.testing.assert_allclose(table[["predicted", "high"]], stored[["predicted", "high"]], rtol=5e-3)


def test_the_parts_of_the_stored_chain_are_those_of_its_specimens():
    pytest.importorskip("skfem")
    from analysis.sand.chain import TABLE, parts, summary

    table = summary([json.loads(line) for line in TABLE.read_text().splitlines()])
    stored = pandas.read_csv(RESULTS / "chain_parts.csv")
    found = parts(table).drop(columns="axial over lateral stress")
    np.testing.assert_allclose(found, stored.drop(columns="axial over lateral stress"), rtol=2e-3)


@pytest.mark.slow
def test_the_stored_samples_and_predictions_give_the_stored_table():
    posterior = posterior_of(grain_tests(USED), read_samples(grain_tests(USED), RESULTS / "samples.jsonl"))
    draws = [json.loads(line) for line in (RESULTS / "predictions.jsonl").read_text().splitlines()]
    stored = pandas.read_csv(RESULTS / "predictions.csv")
    table = compare(posterior, grain_tests(OTHERS), draws)
    assert len(draws) == DRAWS and (table["inside"] == stored["inside"]).all()
    np.testing.assert_allclose(table["measured"], stored["measured"], rtol=1e-3)
    np.testing.assert_allclose(table["high"], stored["high"], atol=0.01)  # the sampler's bits differ between computers


def test_the_stored_scores_are_those_of_the_stored_predictions():
    stored = pandas.read_csv(RESULTS / "score.csv")
    files = {"drained": "predictions.csv", "undrained": "undrained.csv"}
    made = pandas.DataFrame([row for of, file in files.items() for row in scored(pandas.read_csv(RESULTS / file), of)])
    numbers = made.select_dtypes("number").columns
    np.testing.assert_allclose(made[numbers], stored[numbers], rtol=6e-3)
