"""The paper's figures from run files written by the model, whose dotted lines must then lie on the solid ones."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import analysis.paper
import labkit
from analysis.paper import contacts, figures
from analysis.paper.ends import ends, sheared
from analysis.paper.ends import main as papers_tests
from analysis.paper.lines import critical_lines
from analysis.paper.model_runs import CALIBRATED, models
from labkit.cli.dispatch import main
from labkit.files.provenance import provenance_of
from labkit.model.parameters import Model

pytestmark = pytest.mark.long

RUNS = {
    "cv-dense": ["cv", 0.606, 2.1e5, "--strain", 0.4],
    "cv-loose": ["cv", 0.724, 3e5, "--strain", 0.4],
    "cv_other-dense_high": ["cv", 0.606, 1e6, "--strain", 0.4],
    "cp_500kPa-medium": ["cp", 0.67, 5e5, "--strain", 0.4],
    "cr_1MPa-dense": ["cr", 0.606, 1e6, "--strain", 0.4],
    "isoc-loose": ["isoc", 0.724, 3e5],
    "isod-dense_high": ["isod", 0.606, 1e6],
    "cyclic-cyclic_loose": ["cyclic_cp", 0.74, 5e5],
    "cp_start-cyclic_loose": ["cp", 0.74, 5e5, "--strain", 0.1],
    "share_cv-yade": ["cv", 0.64, 3e5, "--strain", 0.1],
}
CV = ("cv-loose", "cv-medium", "cv-dense")
DRAW = {
    "fig_1": figures.fig_1,
    "fig_4": figures.fig_4,
    "fig_5": figures.fig_5,
    "fig_6": figures.fig_6,
    "fig_7": figures.fig_7,
    "fig_8": figures.fig_8,
    "critical_lines": figures.critical_lines,
    "evolution": lambda runs, models: figures.evolution(runs, models, CV),
    "isotropic_statistics": figures.isotropic_statistics,
    "engines": lambda runs, models: figures.engines(runs),
    "strength_shares": lambda runs, models: figures.strength_shares(runs),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    (folder / "runs").mkdir()
    for name, (path, e, pressure, *more) in RUNS.items():
        words = ["model", path, "--void-ratio", e, "--pressure", pressure, *more]
        assert main([*map(str, words), "-o", str(folder / "runs" / f"{name}.run.nc")]) == 0
    return folder


@pytest.fixture(scope="module")
def runs(folder):
    return analysis.paper.runs(folder)


@pytest.mark.parametrize("name", DRAW)
def test_figure_of_available_runs(name, runs, folder, tmp_path):
    figure = DRAW[name](runs, models(folder))
    assert any(line.get_xdata().size > 10 for axes in figure.axes for line in axes.lines)
    file = figures.save(figure, tmp_path / "f.png", runs)
    known = provenance_of(file)
    assert known["command"] == "./lab paper" and len(known["inputs"]) == len(RUNS)


@pytest.mark.parametrize("name", DRAW)
def test_figure_without_runs_lists_them(name, tmp_path):
    figure = DRAW[name]({}, models(tmp_path))
    assert figure.get_suptitle().startswith("missing: ")
    plt.close(figure)


def test_model_lies_on_itself_and_missing_runs_are_named(runs, folder):
    figure = figures.fig_4(runs, models(folder) | {CALIBRATED: models(folder)["Table 2"].with_parameters(c_M=50.0)})
    assert "cv-medium" in figure.get_suptitle() and "cv-dense" not in figure.get_suptitle()
    lines = [line for line in figure.axes[1].lines if len(line.get_xdata())]  # q against strain of the loose test
    simulation, c0, table_2, calibrated = (np.array(line.get_ydata()) for line in lines)
    np.testing.assert_allclose(c0, simulation)
    np.testing.assert_allclose(table_2, simulation, rtol=1e-5, atol=1e-6)
    assert np.abs(calibrated - simulation).max() > 1e-3
    plt.close(figure)


def test_a_run_without_contacts_at_the_start_has_no_model(runs, folder):
    empty = runs["cv-loose"].copy()
    empty["coordination_number"] = 0.0 * empty["coordination_number"]
    figure = figures.fig_4({"cv-loose": empty}, models(folder))
    assert len([line for line in figure.axes[1].lines if len(line.get_xdata())]) == 2  # the simulation and C0
    plt.close(figure)


def test_critical_line_and_its_fit(runs, known):
    p, e = figures.critical_line(Model())
    assert (np.diff(e) > 0).all() and (np.diff(p) < 0).all() and p[-1] == 0.0 and e[-1] == 0.76
    assert figures.fitted_lines({}) is None and figures.fitted_lines({"cv-dense": runs["cv-dense"]}) is None
    fitted = figures.fitted_lines(figures.monotonic(known)).parameters
    lines = critical_lines(ends(sheared(papers_tests(known)))).set_index("parameter")["value"]
    for name in ("e_cmax", "c_cZ", "gamma_cZ", "c_cLam"):  # drawn as in the table
        assert getattr(fitted, name) == pytest.approx(lines[name])
    assert fitted.c_cLam == pytest.approx(Model().parameters.c_cLam, rel=0.1)


def test_only_the_papers_tests_are_monotonic(runs):
    assert set(figures.monotonic(runs)) == {
        "cv-dense",
        "cv-loose",
        "cv_other-dense_high",
        "cp_500kPa-medium",
        "cr_1MPa-dense",
    }


def test_size_groups(run_file, tmp_path):
    assert contacts.read_size_groups(tmp_path) is None
    assert figures.fig_2(None).get_suptitle().startswith("missing: ")
    run = labkit.open_run(run_file)
    contacts.write_size_groups(run, tmp_path)
    groups = contacts.read_size_groups(tmp_path)
    weighted = (groups["by_contacts"].values[..., None, None] * groups["per_contact"].values).sum(axis=1)
    np.testing.assert_allclose(weighted, groups["love"].values, rtol=1e-9, atol=1.0)  # Eq. 15
    assert len(figures.fig_2(groups).axes) == 3
    plt.close("all")
