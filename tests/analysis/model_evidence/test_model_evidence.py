"""The evidence for the model: inversion of C0, increments, gains and errors with known answers."""

import numpy as np
import pandas
import pytest

from analysis.model_evidence.errors import TESTED, combined, error_summary
from analysis.model_evidence.increments import Increments, _intervals, amended, excess, fit_rate, force, lines_of
from analysis.model_evidence.inversion import inverted
from analysis.model_evidence.residuals import _gain, forms_of_c4
from labkit.micro import deviatoric_stress, mean_stress
from labkit.sff import c0_stress

pytestmark = pytest.mark.long

LINES = np.array([0.77, 6.0, 0.76, 0.10])


def test_the_inversion_of_c0_is_exact_without_mobilisation():
    rng = np.random.default_rng(0)
    n, axis = 20, np.diag([-0.5, -0.5, 1.0])
    e, Z, Lam = rng.uniform(0.6, 0.75, n), rng.uniform(4, 6, n), rng.uniform(1e-3, 1e-2, n)
    a, f = rng.uniform(-0.5, 0.5, n), rng.uniform(-0.8, 0.8, n)
    A, F = a[:, None, None] * axis, f[:, None, None] * axis
    stress = c0_stress(1.5e8, Z, Lam, e, A, F, 0.0 * F)
    found = inverted(mean_stress(stress), deviatoric_stress(stress), e, Z, a, 1.5e8)
    assert found[0] == pytest.approx(Lam) and found[1] == pytest.approx(f)


def test_intervals_do_not_cross_a_reversal():
    step = np.concatenate([np.full(50, 1e-3), np.full(80, -1e-3)])
    ends = _intervals(step, 0.0 * step, 0.007)
    assert 50 in ends and ends[0] == 0 and ends[-1] == 130
    assert set(np.diff(ends)[:6]) == {7}  # the same at small and large strains


def made(rng, c):
    """Increments of eight tests along two paths, whose Lambda follows the amended C4 with coefficient c exactly."""
    tests, steps = 8, 300
    count = tests * steps
    n = np.tile(np.where(np.arange(steps) < 200, 1.0, -1.0), tests)
    wave = np.tile(np.linspace(0.0, 1.0, steps), tests)
    state = {
        "e": np.repeat(rng.uniform(0.62, 0.72, tests), steps),
        "Z": np.full(count, 5.0),
        "L": 0.004 + 0.006 * wave * np.repeat(rng.uniform(0.5, 1.5, tests), steps),
        "A": 0.5 * np.sin(3.0 * wave),
        "F": 0.8 * np.sin(4.0 * wave),
        "T": 0.05 * np.sin(5.0 * wave),
    }
    state["reported"] = state["e"] + 0.002
    first = np.arange(0, count, 5)
    test = np.repeat(np.arange(tests), steps // 5)
    data = Increments(
        state,
        np.full(count, 1e-3),
        n,
        1e-4 * np.sin(7.0 * wave),
        first,
        {},
        np.array([f"t{k}" for k in test]),
        np.where(test < 4, "cv", "cp"),
        np.array([f"s{k % 6}" for k in test]),
        np.zeros(count),
    )
    u = np.array([1.0, 0.3, 20.0, np.log(0.075), c])
    data.change["L"] = data.total(amended(u, data, lines_of(data, LINES)))
    return data


def test_a_missing_term_of_c4_is_found_and_a_present_one_is_not():
    data = made(np.random.default_rng(1), 8.0)
    lines = lines_of(data, LINES)
    start = (1.0, 0.3, 20.0, float(np.log(0.075)))
    every = np.ones(len(data.run), bool)
    found = fit_rate(amended, "L", (*start, 4.0), data, lines, every)
    assert found[4] == pytest.approx(8.0, rel=0.01)
    plain = fit_rate(force, "L", start, data, lines, every)
    left = data.change["L"] - data.total(force(plain, data, lines))
    assert np.abs(left).max() > 0.05 * np.abs(data.change["L"]).max()
    forms = forms_of_c4(data, LINES).set_index("form")
    assert forms["gain"]["amended"] > 0.9 and forms["low"]["amended"] > 0.0
    assert np.isnan(forms["gain"]["paper"]) and np.abs(excess(data)).max() > 0.5


def test_gains_count_a_specimen_once():
    table = pandas.DataFrame(
        {"specimen": ["a", "a", "a", "b"], "path": "cv", "before": 1.0, "after": [0.5, 0.5, 0.5, 2.0]}
    )
    assert _gain(table, ["cv"])["gain"] == pytest.approx(0.0) and _gain(table, ["cv"])["specimens"] == 2


def test_models_are_compared_on_the_same_specimens():
    rng = np.random.default_rng(2)
    rows = []
    for k in range(8):
        scale = rng.uniform(0.05, 0.3)
        for model in ("Table 2", *TESTED):
            factor = 0.5 if model == "amended" else 1.0
            rows.append(
                {
                    "run": f"cv-{k}",
                    "specimen": f"s{k}",
                    "path": "cv",
                    "model": model,
                    "q_error": factor * scale * rng.uniform(0.98, 1.02),
                    "p_error": factor * scale * rng.uniform(0.98, 1.02),
                    "e_error_of_change": np.nan,
                    "reached": 0.5 if model == "C4 by distance" and k == 0 else 1.0,
                    "status": "",
                }
            )
    table = pandas.DataFrame(rows)
    found = combined(table).set_index("model")
    assert found["ratio"]["amended"] == pytest.approx(0.5, rel=0.02) and found["verdict"]["amended"] == "better"
    assert found["verdict"]["reported void ratio"] == "not resolved"
    assert found["failed"]["C4 by distance"] == 1 and found["specimens"]["calibrated"] == 8
    summary = error_summary(table).set_index(["model", "quantity"])
    assert summary.loc[("amended", "q_error"), "verdict"] == "better"
    assert summary.loc[("amended", "q_error"), "specimens"] == 8
