import json

import numpy as np
import pandas
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("emcee")

from analysis.sand.karlsruhe import DRAWS, OTHERS, RESULTS, USED, compare, features, grain_tests
from labkit.laboratory_data import posterior_of, read_samples


def test_features_are_those_of_a_simple_curve():
    strain = np.linspace(0.0, 0.1, 101)
    found = features({"strain": strain, "ratio": 15.0 * strain, "volume": -0.5 * strain})
    assert found["largest q/p"] == pytest.approx(1.5)
    assert found["largest rate of dilation"] == pytest.approx(0.5)
    assert found["volumetric strain at the end"] == pytest.approx(-0.05)


@pytest.mark.slow
def test_the_stored_samples_and_predictions_give_the_stored_table():
    posterior = posterior_of(grain_tests(USED), read_samples(grain_tests(USED), RESULTS / "samples.jsonl"))
    draws = [json.loads(line) for line in (RESULTS / "predictions.jsonl").read_text().splitlines()]
    stored = pandas.read_csv(RESULTS / "predictions.csv")
    table = compare(posterior, grain_tests(OTHERS), draws)
    assert len(draws) == DRAWS and (table["inside"] == stored["inside"]).all()
    np.testing.assert_allclose(table["measured"], stored["measured"], rtol=1e-3)
    np.testing.assert_allclose(table["high"], stored["high"], atol=0.01)  # the sampler's bits differ between computers
