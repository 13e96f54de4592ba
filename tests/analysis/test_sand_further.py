"""What is predicted with the draws of the calibrated grains: cyclic tests, sands, a Hertz law."""

import numpy as np
import pandas
import pytest

from analysis.sand import cyclic, moduli
from analysis.sand.karlsruhe import RESULTS
from analysis.sand.with_fabric import FIRST_SAND, FREE, SANDS, SANDS_SEED, fabric_tests, lines_of
from analysis.sand.with_fabric_table import FILES, compared
from labkit.plugins.laboratory_data import read_samples


def test_every_cyclic_test_keeps_the_volume_and_has_its_own_state():
    tests = {name: cyclic.test_of(name, 7) for name in cyclic.STRESS_CYCLES | cyclic.STRAIN_CYCLES}
    assert len(tests) == 12 and len({(repr(path), e) for path, _, e in tests.values()}) == 12
    for path, pressure, void_ratio in tests.values():
        assert path.cyclic and [held.kind for held in path.held()] == ["volume"]
        assert 100e3 <= pressure <= 200e3 and 0.7 < void_ratio < 1.0


def test_stored_cycles_give_the_stored_table():
    measured = pandas.read_csv(cyclic.TABLE).set_index("test")["measured"].to_dict()
    lines = [*cyclic.lines_of_draws(lines_of(FILES["draws"])), *lines_of(RESULTS / "with_fabric_cycles.jsonl")]
    made = cyclic.table_of(lines, measured)
    stored = pandas.read_csv(cyclic.TABLE)
    numbers = made.select_dtypes("number").columns
    np.testing.assert_allclose(made[numbers], stored[numbers], rtol=1e-3)
    summary = cyclic.summary(stored).set_index("criterion")
    assert summary["tests"].sum() == len(stored) and (summary["inside"] <= summary["tests"]).all()


def test_sands_share_neither_parameters_nor_specimens_with_the_samples():
    tests, (low, high) = fabric_tests(), np.array([*FREE.values()]).T
    samples, sands = (read_samples(tests, FILES[name]) for name in ("samples", "sands"))
    assert not {sample.seed for sample in samples} & {sand.seed for sand in sands}
    drawn = np.random.default_rng(SANDS_SEED).uniform(low, high, (SANDS, len(FREE)))
    for number, sand in enumerate(sands):
        assert sand.seed == FIRST_SAND + number
        assert [*sand.parameters.values()] == pytest.approx(drawn[number].tolist())


def test_the_nearest_draw_is_the_one_with_the_measured_features():
    exact = {"parameters": {"friction": 0.1}, "tests": {}}
    stored = lines_of(FILES["draws"])
    for _, test, feature, measured, *_ in compared(stored[:1]):
        exact["tests"].setdefault(test, {"features": {}})["features"][feature] = measured
    assert moduli.nearest([*stored, exact]) == exact["parameters"]
    assert moduli.nearest(stored) in [draw["parameters"] for draw in stored]


def test_a_modulus_serves_both_only_if_it_is_near_the_least_misfit_of_each():
    tests = fabric_tests()
    measured, scale = tests.points(tests.measured), np.sqrt(np.diag(tests.deviations))
    law = next(iter(moduli.MODULI))

    def line(modulus: float, drained: float, compression: float) -> dict:
        points = measured + scale * np.repeat([drained, compression, 0.0], [24, 3, 3])
        return {"law": law, "modulus": modulus, "points": points.tolist()}

    table = moduli.table_of([line(0.1, 1.0, 9.0), line(0.4, 1.4, 1.4), line(1.6, 9.0, 1.0)])
    assert table["drained"].tolist() == pytest.approx([1.0, 1.4, 9.0])
    assert table["both"].tolist() == [False, True, False]


def test_a_prediction_that_is_stored_is_not_repeated(tmp_path):
    file = tmp_path / "cycles.jsonl"
    file.write_text('{"draw": 0, "test": "TCUE1", "of": 10, "cycles": 1.0}\n')
    cyclic.predict([{"parameters": {}, "tests": {}}], {"TCUE1": 0.6}, file)
    assert len(lines_of(file)) == 1
