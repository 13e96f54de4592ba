"""Figures for a paper: one meaning per axis, only measured strength, styles of the user, and no text of the code."""

import matplotlib
import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.errors import InputError
from labkit.figures import path_figures, plots, sff_figures
from labkit.figures.frame import colors_for, new_panels, plain_ticks
from labkit.micro.stress import equivalent_stress
from labkit.results.figures import figure_for

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cv(run_file):
    return lk.open_run(run_file)


@pytest.fixture(scope="module")
def sheared(shear_file):
    return lk.open_run(shear_file)


@pytest.fixture(scope="module")
def turned(soft_specimen):
    path = lk.paths.StressRotation(pressure=1e5, stress_ratio=0.3, rotation=90.0, strain=0.02)
    return lk.run(soft_specimen, path, progress=False).data


def test_q_has_one_definition_on_an_axis(cv, sheared):
    alone, both = plots.test(cv)[0], plots.test({"cv": cv, "shear": sheared})
    assert "invariant" not in alone.axes[0].get_ylabel() and "invariant" in both[0].axes[0].get_ylabel()
    drawn = both[1]["q_Love_Pa"].to_numpy()
    expected = np.concatenate([equivalent_stress(run["stress"].values) for run in (cv, sheared)])
    np.testing.assert_allclose(drawn, expected, rtol=1e-6)


@pytest.mark.parametrize("name", ["test", "stress_path", "pi_plane", "shear"])
def test_figures_can_leave_the_equation_out(sheared, name):
    drawn = lk.Run(sheared).plot(name, equation=False)
    texts = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert not any("equation" in text for text in texts)
    runs = [line for line in drawn.axes[0].get_lines() if len(line.get_xdata()) == sheared.sizes["time"]]
    assert len(runs) == 1


def test_the_command_can_leave_the_equation_out(shear_file, tmp_path):
    words = ["figure", "test", str(shear_file), "-o", str(tmp_path / "x.png"), "--csv", str(tmp_path / "x.csv")]
    assert main([*words, "--equation", "false"]) == 0
    assert "q_Love_Pa" in (text := (tmp_path / "x.csv").read_text()) and "C0" not in text
    words = ["figure", "records", str(shear_file), "--variable", "void_ratio", "-o", str(tmp_path / "e.png")]
    assert main(words) == 0
    assert main(["figure", "planes", str(shear_file), "--snapshot", "-2", "-o", str(tmp_path / "p.png")]) == 0


def test_a_prescribed_stress_is_no_strength(turned):
    other = turned.assign_attrs(scene=lk.Scene(friction=0.5).to_json())
    figure, _ = path_figures.pi_plane(other)
    assert not figure.axes[0].get_title()
    names = {text.get_text() for text in figure.legends[0].get_texts()}
    assert not names & {"Mohr-Coulomb", "Matsuoka-Nakai", "model"}


def test_the_default_of_a_rotation_shows_its_response(turned):
    figure, drawn = path_figures.rotation_response(turned)
    assert figure_for(turned.lab.path) == "rotation"
    assert drawn["angle_degrees"].iloc[-1] == pytest.approx(90.0, abs=1.0)
    y = figure.axes[1].get_lines()[0].get_ydata()
    np.testing.assert_allclose(y, 200 * 0.5 * (turned["strain"].values[:, 0, 2] + turned["strain"].values[:, 2, 0]))
    assert {"angle of $\\sigma_1$ from z (degrees)"} == {one.get_xlabel() for one in figure.axes[:4]}


def test_cycles_of_shear_are_drawn_against_sigma_z_and_a_monotonic_test_is_refused(sheared, cv):
    with pytest.raises(InputError, match="draws tests that reverse"):
        path_figures.cycles(cv)
    with pytest.raises(InputError, match="draws tests that reverse"):
        path_figures.cycles({"shear": sheared})
    panel = next(axes for axes in path_figures.shear(sheared)[0].axes if "normal stress" in axes.get_xlabel())
    np.testing.assert_allclose(panel.get_lines()[0].get_xdata(), 1e-3 * sheared["stress"].values[:, 2, 2])


def test_compression_is_drawn_against_the_logarithm_of_sigma_z(cv):
    figure, drawn = path_figures.compression(cv)
    assert figure.axes[0].get_xscale() == "log" and figure.axes[0].get_xlabel().startswith("normal stress")
    np.testing.assert_allclose(drawn["sigma_zz_Pa"], cv["stress"].values[:, 2, 2])
    for name in ("oedometer", "oedometer_reloading"):
        assert figure_for(lk.paths.make_path(name)) == "compression"


@pytest.mark.parametrize(
    ("low", "high"), [(0.2, 0.3), (90.0, 130.0), (1.0, 9.0), (1.0, 60.0), (0.01, 4e3), (1e-6, 1e4)]
)
def test_a_logarithmic_axis_has_two_to_twelve_labels(low, high):
    figure, axes = new_panels(1, 1, 3.0, 4.0)
    axes.plot([low, high], [0, 1])
    axes.set(xscale="log", xlim=(low, high))
    plain_ticks(axes.xaxis)
    figure.canvas.draw()
    ticks = [x for x in axes.xaxis.get_majorticklocs() if low <= x <= high]
    assert 2 <= len(ticks) <= 12


def test_negative_terms_are_stacked_below_zero(cv):
    _, axes = new_panels(1, 1, 3.0)
    shares = cv.lab.strength_shares()
    shares.values[1] = -np.abs(shares.values[1])
    sff_figures.draw_stack(axes, np.arange(shares.sizes["time"]), shares)
    below = min(path.vertices[:, 1].min() for one in axes.collections for path in one.get_paths())
    assert below == pytest.approx(shares.values.clip(max=0.0).sum(axis=0).min())
    above = max(path.vertices[:, 1].max() for one in axes.collections for path in one.get_paths())
    assert above == pytest.approx(shares.values.clip(min=0.0).sum(axis=0).max())
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), shares.values.sum(axis=0))


def test_colours_and_sizes_are_those_of_the_user(cv):
    cycle = matplotlib.cycler(color=["#111111", "#555555"])
    with matplotlib.rc_context({"axes.prop_cycle": cycle, "font.size": 7}):
        assert tuple(colors_for(2)) == ("#111111", "#555555")
        drawn = plots.test(cv)[0]
        assert drawn.axes[0].get_lines()[0].get_color() == "#111111"
        assert drawn.legends[0].get_texts()[0].get_fontsize() <= drawn.axes[0].xaxis.label.get_fontsize()
    assert colors_for(1)[0] != "#111111"
