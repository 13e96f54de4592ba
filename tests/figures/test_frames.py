"""Every figure has the name of its run, labels, and curves inside the frame, and leaves nothing in pyplot."""

import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import labkit
from labkit import cli
from labkit.figures import plots
from labkit.figures.frame import describe_run, include_zero, name_of, new_figure, strain_axis
from labkit.micro.stress import mean_stress
from labkit.paths.registry import accumulated_strain
from labkit.results.figures import FIGURES
from labkit.results.run import Run

pytestmark = pytest.mark.slow

CYCLIC = ("cycles", "liquefaction")  # the run is monotonic
OF_RUNS = [name for name in FIGURES if FIGURES[name].needs != "probes" and name not in CYCLIC]


@pytest.fixture(scope="module")
def run(run_file):
    return labkit.open_run(run_file)


def options(figure):
    return {"variable": "stress"} if figure == "records" else {}


@pytest.mark.parametrize("figure", OF_RUNS)
def test_a_figure_names_its_run_and_stays_out_of_pyplot(figure, run):
    before = plt.get_fignums()
    drawn = Run(run).plot(figure, **options(figure))
    assert plt.get_fignums() == before
    assert drawn.get_suptitle().startswith("small: path cv, ") and "engine" in drawn.get_suptitle()
    assert drawn._repr_png_()[:4] == b"\x89PNG" and len(FIGURES[figure](run, **options(figure))[1]) > 1
    for axes in drawn.axes:
        if axes.name != "polar":
            assert axes.get_xlabel() or (axes.get_label() == "<colorbar>" and axes.get_ylabel())


def test_a_run_in_memory_is_named_after_its_path(run):
    memory = run.copy()
    memory.encoding = {}
    assert name_of(run) == "small" and name_of(memory) == "cv"


def test_the_users_figure_is_given_the_name_once(run):
    figure = new_figure(3, 3)
    for _ in range(2):
        plots.name_run(figure, run)
    assert figure.get_suptitle() == describe_run(run)


def test_importing_the_figures_leaves_the_backend_alone():
    program = "import matplotlib; matplotlib.use('svg'); import labkit.figures.plots, labkit.figures.micro_figures; "
    program += "assert matplotlib.get_backend() == 'svg', matplotlib.get_backend()"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


def test_a_constant_mean_stress_lies_inside_the_frame(run):
    """In a CP test, p must neither hide under the frame nor fill the panel with its noise; the error is shown."""
    p = xr.DataArray(mean_stress(run["stress"].values), dims="time")
    constant = run.assign({name: run[name] / p * 5e5 for name in ("stress", "stress_sff", "stress_sff_by_volume")})
    _, pressure, error = plots.sff_against_love({"cp": constant}).axes
    low, high = pressure.get_ylim()
    assert low < 460.0 and high > 540.0  # kPa
    np.testing.assert_allclose(
        error.lines[0].get_ydata(), 100.0 * constant.lab.sff_error("stress_sff_by_volume").values
    )


def test_zero_and_a_margin_are_included_on_both_sides():
    axes = new_figure(3, 3).subplots()
    axes.plot([0, 1], [-1.0, 2.0])
    include_zero(axes, "y")
    assert axes.get_ylim()[0] < -1.0 and axes.get_ylim()[1] > 2.0
    include_zero(axes, "x")
    assert axes.get_xlim()[0] == 0.0


def test_ticks_of_the_family_are_plain_numbers(run):
    figure = Run(run).plot("family")
    figure.canvas.draw()
    for axes in figure.axes:
        labels = [tick.get_text() for tick in axes.get_yticklabels() + axes.get_yticklabels(minor=True)]
        assert any(labels) and all(float(label) > 0.0 for label in labels if label)


def test_the_table_of_directions_is_plain_text(run):
    _, table = FIGURES.require("directions")(run)
    assert table["function"].nunique() == 3 and not table["function"].str.contains(r"[$\\{}]").any()


def test_components_of_tensors(run):
    legend = Run(run).plot("records", variable="strain").legends[0]
    assert [text.get_text() for text in legend.get_texts()] == ["xx", "xy = yx", "xz = zx", "yy", "yz = zy", "zz"]
    asymmetric = run.assign(strain=run["strain"].copy(data=np.random.default_rng(1).normal(size=run["strain"].shape)))
    _, table = FIGURES.require("records")(asymmetric, variable="strain")
    assert list(table.columns[1:]) == [f"strain_{i}{j}" for i in "xyz" for j in "xyz"]


def test_a_path_that_reverses_is_drawn_over_the_accumulated_strain(run):
    assert strain_axis(run)[0] == "axial strain (%)"
    axial = np.sin(np.linspace(0.0, 6.0, run.sizes["time"]))
    strain = run["strain"].copy(data=axial[:, None, None] * np.diag([0.0, 0.0, 1.0]))
    back = run.assign_coords(axial_strain=("time", axial)).assign(strain=strain)
    label, strain = strain_axis(back)
    assert label == "accumulated axial strain (%)"
    np.testing.assert_allclose(strain, 100 * accumulated_strain(back["axial_strain"].values))
    np.testing.assert_array_equal(strain_axis(back, at_snapshots=True)[1], strain[back["record"].values])


def test_a_prediction_of_the_model_has_no_stress_of_love(run):
    model = run.copy()
    model.attrs = {**run.attrs, "engine": "model"}
    texts = [text.get_text() for text in plots.sff_against_love({"m": model}).legends[0].get_texts()]
    assert texts == ["constitutive model (C0)"]


@pytest.mark.parametrize("name", ["a$_$b", "$x$", "_a", "price_$", r"\x1b"])
def test_names_are_drawn_as_they_are(name, run, tmp_path):
    """They are neither mathematics nor hidden labels."""
    shown = name.replace("$", r"\$")
    for figure in (
        plots.test({name: run, "other": run})[0],
        plots.e_p_paths({name: run, "other": run}, {name: (np.ones(2), np.ones(2))}),
    ):
        assert shown in [text.get_text().strip() for legend in figure.legends for text in legend.get_texts()]
        figure.savefig(tmp_path / "a.png", dpi=20)
    named = run.copy()
    named.encoding, named["extra"] = {"source": f"{name}.run.nc"}, run["stress"].assign_attrs(long_name=name)
    drawn = Run(named).plot("records", variable="extra")
    assert drawn.get_suptitle().strip().startswith(f"{shown}: path") and shown in drawn.axes[0].get_ylabel()
    drawn.savefig(tmp_path / "a.png", dpi=20)


@pytest.mark.parametrize("command", ["figure test", "verify", "critical --min-strain 0.1%"])
@pytest.mark.parametrize("name", [".run.nc", "a$_$b.run.nc"])
def test_a_run_file_may_have_any_name(name, command, run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for file in (name, "other.run.nc"):
        (tmp_path / file).write_bytes(run_file.read_bytes())
    assert cli.main([*command.split(), name, "other.run.nc", "-o", "a.png"]) in (0, 1), capsys.readouterr().err
