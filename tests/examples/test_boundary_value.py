"""The boundary value problem on small meshes: uniform specimens, convergence, cuts, two programs."""

import itertools
import re

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install 'labkit[fem]'")

from examples.boundary_value import footing
from examples.boundary_value import problem as definition
from examples.boundary_value.__main__ import main
from examples.boundary_value.problem import FIELDS, PRESSURE, VOID_RATIO
from examples.boundary_value.scikit_fem import ScikitFem
from labkit.errors import PhysicsError
from labkit.model import Adaptive, Model, drive, isotropic_state, model_path, update
from labkit.plugins.umat import Library, build, copy_sources, missing_compilers

pytestmark = pytest.mark.long


def in_python(columns=1, tolerance=1e-4):
    model = Model()
    return ScikitFem(columns, lambda state, increment: update(model, state, increment, tolerance=tolerance), model)


def solve(problem, strain=0.002, increments=4):
    return problem.run(strain, increments, lambda fraction, text: None)


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """The compiled law."""
    if missing_compilers():
        pytest.skip(f"{' and '.join(missing_compilers())} not installed: apt-get install gfortran gcc")
    folder = tmp_path_factory.mktemp("law")
    copy_sources(folder)
    return build(folder)


@pytest.fixture
def in_kratos(library):
    """A function columns -> the problem in Kratos."""
    pytest.importorskip(
        "KratosMultiphysics.GeoMechanicsApplication", reason="Kratos is not installed: pip install 'labkit[kratos]'"
    )
    from examples.boundary_value.kratos import InKratos

    return lambda columns: InKratos(columns, library, Model())


def test_a_uniform_specimen_is_an_element_test(monkeypatch):
    """The stress is that of the path plane_strain, with constant lateral stress and no strain out of the plane."""
    monkeypatch.setattr(definition, "LOOSER", 0.0)
    model, problem = Model(), in_python(tolerance=1e-7)
    history = solve(problem)
    path = model_path("plane_strain", PRESSURE, strain=0.002)
    expected = drive(model, path, isotropic_state(model, VOID_RATIO, PRESSURE), 5e-4, Adaptive(1e-10)).require()
    np.testing.assert_allclose(history.stress, expected.stress[:, 2, 2], rtol=1e-4)
    for name in FIELDS:
        assert np.ptp(problem.field(name)) < 1e-6


def assert_quadratic(history):
    """Every iteration leaves at most 10 r^2 and the error of the tangent, 1e-4 r with the default tolerance."""
    for residuals in history.residuals:
        for before, after in itertools.pairwise(residuals):
            assert after < 10.0 * (before**2 + 1e-4 * before)


def test_newton_converges_quadratically():
    problem = in_python(columns=2)
    history = solve(problem)
    assert history.cuts == 0 and history.iterations.max() <= 5
    assert_quadratic(history)
    e = problem.field("e")
    assert e.max() > VOID_RATIO + 0.02 and e.min() < VOID_RATIO + 0.01
    assert e[0, 0].mean() > e[0, 1].mean() > e[3, 1].mean()  # looser at the lower left corner


def test_newton_converges_quadratically_over_a_cycle():
    """Extension after compression and back: the residual falls as in first loading, from the first increment on."""
    problem = in_python(columns=2)
    parts = [solve(problem, strain, increments) for strain, increments in ((0.002, 4), (-0.004, 8), (0.004, 8))]
    for history, strain in zip(parts, (0.002, -0.004, 0.004), strict=True):
        assert history.strain[-1] == pytest.approx(strain) and history.cuts == 0
        assert history.iterations.max() <= 6
        assert all(residuals[-1] < definition.TOLERANCE for residuals in history.residuals)
    compressed, extended, again = (history.stress[-1] for history in parts)
    assert extended < min(compressed, again)


def test_kratos_and_scikit_fem_find_the_same_solution(in_kratos, library):
    problem, model = in_kratos(2), Model()
    history = solve(problem, increments=2)
    assert history.cuts == 0 and history.iterations.max() <= 5
    assert_quadratic(history)
    other = ScikitFem(2, Library(library, model).update, model)
    np.testing.assert_allclose(history.stress, solve(other, increments=2).stress, rtol=1e-4)
    for name, error in zip(FIELDS, (2e-3, 2e-2, 2e-3), strict=True):  # the elements differ
        np.testing.assert_allclose(problem.field(name).mean(axis=2), other.field(name).mean(axis=2), atol=error)


def test_a_point_in_kratos_that_missed_an_increment_is_noticed(in_kratos):
    """Kratos passes no PNEWDT: a point at which the law fails keeps its void ratio, which contradicts its strain."""
    problem = in_kratos(1)
    problem.initial = problem.initial + 1e-4
    with pytest.raises(PhysicsError, match="failed at 8 points"):
        solve(problem, 5e-4, 1)


def test_an_increment_that_fails_is_halved():
    model = Model()
    calls = []

    def law(state, increment):
        found = update(model, state, increment)
        calls.append(np.abs(increment).max())
        if calls[-1] > 1.2e-3:
            found.status[0] = 1
        return found

    history = solve(ScikitFem(1, law, model), increments=1)
    assert history.cuts >= 1 and history.strain[-1] == pytest.approx(0.002)


def test_the_program_prints_the_same_stress_for_both_programs(library, capsys):
    """To the last digit, 1e-4 MPa."""
    main(2, 5e-4, 1)
    found = re.findall(r"(.*): ([\d.]+) MPa at 0.05% axial strain", capsys.readouterr().out)
    stress = [float(value) for _, value in found]
    assert found[0][0] == "scikit-fem" and stress[0] > PRESSURE / 1e6
    assert stress == pytest.approx(stress[:1] * len(stress), abs=1.01e-4)


def test_a_footing_is_loaded_unloaded_and_loaded_again(tmp_path, monkeypatch):
    """Newton converges in every increment; the pressure falls on unloading and rises on reloading."""
    table = footing.cycle(parts=2, increments=2)
    assert set(table["model"]) == set(footing.MODELS)
    for _, own in table.groupby("model"):
        pressure = own.groupby("part", sort=False)["pressure"].last()
        assert pressure["loading"] > 2.0 * footing.SURCHARGE / 1e3 > 0.0
        assert pressure["unloading"] < min(pressure["loading"], pressure["reloading"])
        assert own["settlement"].iloc[-1] == pytest.approx(sum(footing.CYCLE))
    residuals = [[float(r) for r in text.split()] for text in table["residuals"]]
    assert all(found[-1] < definition.TOLERANCE for found in residuals)
    assert table["iterations"].max() <= 7
    monkeypatch.chdir(tmp_path)
    footing.figure(table).savefig("footing.png")
