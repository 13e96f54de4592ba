"""The boundary value problem on small meshes: uniform specimens, convergence, cuts, the command."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install 'labkit[fem]'")

from analysis import __main__ as studies
from analysis.boundary_value import biaxial
from analysis.boundary_value.biaxial import PRESSURE, Biaxial
from labkit.model import Adaptive, Model, drive, isotropic_state, model_path, update


def solve(model, tolerance=1e-4, columns=1, strain=0.002, increments=4):
    problem = Biaxial(columns, lambda state, increment: update(model, state, increment, tolerance=tolerance), model)
    return problem, problem.run(strain, increments, lambda fraction, text: None)


def test_a_uniform_specimen_is_an_element_test(monkeypatch):
    """The stress of the path plane_strain, in which the lateral stress is held and there is no strain out of plane."""
    monkeypatch.setattr(biaxial, "LOOSER", 0.0)
    model = Model()
    problem, history = solve(model, 1e-7)
    path = model_path("plane_strain", PRESSURE, strain=0.002)
    expected = drive(model, path, isotropic_state(model, biaxial.VOID_RATIO, PRESSURE), 5e-4, Adaptive(1e-10)).require()
    np.testing.assert_allclose(history.stress, expected.stress[:, 2, 2], rtol=1e-4)
    for name in ("e", "Z", "|A|"):
        assert np.ptp(problem.field(name)) < 1e-6


def test_newton_converges_quadratically():
    problem, history = solve(Model(), columns=2)
    assert history.cuts == 0 and history.iterations.max() <= 6
    for residuals in history.residuals:
        last, before = residuals[-1], residuals[-2]
        assert last < 10.0 * before**1.7 or last < 1e-12
    e = problem.field("e")
    assert e.max() > biaxial.VOID_RATIO + 0.02 and e.min() < biaxial.VOID_RATIO + 0.01


def test_an_increment_that_fails_is_halved():
    model = Model()
    calls = []

    def law(state, increment):
        found = update(model, state, increment)
        calls.append(np.abs(increment).max())
        if calls[-1] > 1.2e-3:
            found.status[0] = 1
        return found

    problem = Biaxial(1, law, model)
    history = problem.run(0.002, 1, lambda fraction, text: None)
    assert history.cuts >= 1 and history.strain[-1] == pytest.approx(0.002)


def test_the_command_writes_table_figure_and_page(tmp_path, capsys):
    options = ["--columns", "1", "2", "--strain", "5e-4", "--increments", "1", "--python", "-o", str(tmp_path)]
    assert studies.main(["boundary-value", *options]) == 0
    assert {"README.md", "biaxial.csv", "biaxial.png"} <= {file.name for file in tmp_path.iterdir()}
    page = (tmp_path / "README.md").read_text()
    assert "quadratic" in page and "law in Python" in page
    assert studies.main(["boundary-value", "--strain", "0.5", "-o", str(tmp_path)]) == 2
