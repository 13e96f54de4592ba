"""Every figure can be read: units, legends, text on the canvas, and lines that stand out on white."""

import matplotlib
import matplotlib.colors
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import labkit as lk
from labkit.engines import Device
from labkit.figures import frame, grading_figure, path_figures, plots, sff_figures
from labkit.figures.critical_figure import ends_of_tests
from labkit.grains.scene import Scene
from labkit.model import Model, as_run, drive, isotropic_state, model_path
from labkit.paths.standard import ConstantMeanStress, ConstantVolume
from labkit.plugins.calibration.figure import FREE, draw_fit
from labkit.plugins.calibration.observation import observe
from labkit.plugins.campaigns.figure import overview, spell_out
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.pictures.picture import draw_grains
from labkit.plugins.probes import probe_model
from labkit.results.critical import critical_states
from labkit.results.figures import FIGURES
from tests.plugins.laboratory_data.columns import of_columns

pytestmark = pytest.mark.slow
CONTRAST = 2.5  # of a line against white (WCAG 2.1); tab:orange, the palest of matplotlib's usual colours, has 2.53
STRESS = ("deviatoric stress", "mean stress", "shear stress", "normal stress", "Love's stress, compression")
OTHERS = ("e_p_paths", "verify", "grading", "picture", "calibration", "overview", "test of many", "critical")
DRAWN = {"variable": "stress"}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A measured drained test, as a Dataset."""
    file = tmp_path_factory.mktemp("measured") / "m.csv"
    rows = [f"{0.01 * k},{0.002 * np.sin(0.3 * k) - 5e-4 * k},{100.0 + 20.0 * k**0.5},100" for k in range(12)]
    file.write_text("\n".join(["e,ev,s1,s3", *rows]) + "\n")
    columns = of_columns(e1="e:1", ev="ev:1", s1="s1:kPa", s3="s3:kPa")
    kinds = {"strain_kind": "logarithmic", "stress_kind": "effective", "source": "-", "licence": "-"}
    path = lk.paths.ConstantRadialStress(pressure="100 kPa", strain=0.1)
    return lk.read_measured(file, path, columns, void_ratio=0.75, **kinds).data


@pytest.fixture(scope="module")
def runs(run_file, liquefied_file, shear_file, measured):
    model = as_run(drive(Model(), model_path("cv", 1e5, strain=0.02), isotropic_state(Model(), 0.66, 1e5)))
    grains = {"cv": run_file, "cycles": liquefied_file, "shear": shear_file}
    return {**{name: lk.open_run(file) for name, file in grains.items()}, "model": model, "measured": measured}


def draw(name, runs, run_file):
    """A figure, by its name in FIGURES or in OTHERS."""
    cv, five = runs["cv"], dict.fromkeys((f"e = 0.6{k}, a long name" for k in range(5)), runs["cv"])
    if name == "envelope":
        return probe_model(isotropic_state(Model(), 0.66, 1e5)).plot()
    if name == "picture":
        return draw_grains([cv.lab.snapshot(0), cv.lab.snapshot(-1)], "cv.run.nc")
    if name == "grading":
        return grading_figure.grading(lk.read_state(run_file))
    if name == "calibration":
        seen = observe("cv", cv)
        return draw_fit([seen], {"cv": seen.values * 1.1})
    if name == "overview":
        paths = ConstantVolume(), ConstantMeanStress(pressure=1e5), ConstantMeanStress(pressure=3e5)
        jobs = [Job(name="x", specimen="sand-void_ratio0.62-s2", path=p, device=Device(), scene=Scene()) for p in paths]
        return overview([(job, run_file) for job in jobs])
    if name == "e_p_paths":
        return plots.e_p_paths(five)
    if name == "critical":
        return ends_of_tests(five, critical_states(five))
    if name == "verify":
        return plots.sff_against_love({"cv": cv, "shear": runs["shear"]})
    if name == "test of many":
        return plots.test({f"test {key}": runs[key] for key in ("cv", "model", "measured")})[0]
    of = {"cycles": "cycles", "liquefaction": "cycles", "shear": "shear"}.get(name, "cv")
    return FIGURES[name](runs[of], **(DRAWN if name == "records" else {}))[0]


@pytest.fixture(scope="module", params=[*FIGURES, *OTHERS, "test of the measured test", "budget of a liquefied test"])
def figure(request, runs, run_file):
    if request.param == "test of the measured test":
        drawn = plots.test(runs["measured"])[0]
    elif request.param == "budget of a liquefied test":
        drawn = sff_figures.budget(runs["cycles"])[0]
    else:
        drawn = draw(request.param, runs, run_file)
    FigureCanvasAgg(drawn).draw()
    return drawn


def test_everything_is_on_the_canvas_and_axes_have_units(figure):
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    assert min(box.x0, box.y0) > -0.02 and box.x1 < width + 0.02 and box.y1 < height + 0.02, (box, width, height)
    for label in (text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())):
        assert "strain" not in label or "%" in label or "increment" in label, label
        assert not label.startswith(STRESS) or "Pa)" in label, label
        assert "volumetric" not in label or "compression positive" in label


IN_AXES = {  # the figures with one panel, drawn in the Axes of a user
    "records": lambda runs, file, ax: FIGURES["records"](runs["cv"], **DRAWN, ax=ax)[0],
    "liquefaction": lambda runs, file, ax: FIGURES["liquefaction"](runs["cycles"], ax=ax)[0],
    "grading": lambda runs, file, ax: grading_figure.grading(lk.read_state(file), ax=ax),
}


def test_a_figure_of_one_panel_draws_in_the_axes_of_a_user(figure, request, runs, run_file):
    name = request.node.callspec.params["figure"]
    assert (len(figure.axes) == 1) == (name in IN_AXES)
    if name in IN_AXES:
        axes = Figure().subplots()
        assert IN_AXES[name](runs, run_file, axes) is axes.figure
        assert axes.lines and axes.get_xlabel() and axes.get_legend()


def test_entries_of_a_legend_differ(figure):
    for legend in [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]:
        handles, texts = legend.legend_handles, [text.get_text() for text in legend.get_texts()]
        assert len(set(texts)) == len(texts)
        looks = [look(one) for one in handles if isinstance(one, Line2D)]
        assert len(set(looks)) == len(looks), texts


def look(line):
    return (
        matplotlib.colors.to_hex(line.get_color()),
        str(line.get_linestyle()),
        str(line.get_marker()),
        matplotlib.colors.to_hex(line.get_markerfacecolor()) if line.get_marker() not in ("None", "") else "",
        line._unscaled_dash_pattern,
    )


def test_lines_stand_out_on_white(figure):
    lines = [
        line for axes in figure.axes for line in axes.get_lines() if line.get_zorder() > 0 and line.get_alpha() != 0
    ]
    for line in lines:
        assert contrast(line.get_color()) > CONTRAST, (line.get_label(), line.get_color())
    if figure.axes and figure.axes[0].name == "rectilinear" and not figure.axes[0].images:
        assert lines


def contrast(color):
    value = np.array(matplotlib.colors.to_rgb(color))
    linear = np.where(value <= 0.03928, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return 1.05 / (linear @ (0.2126, 0.7152, 0.0722) + 0.05)


@pytest.mark.parametrize("number", [1, 5, 10, 11, 40])
def test_colours_of_many_curves_stand_out_and_differ(number):
    for colors in (frame.colors_for(number), frame.ordered_colors(number)):
        assert min(map(contrast, colors)) > CONTRAST and len({matplotlib.colors.to_hex(c) for c in colors}) == number


def test_a_measured_test_has_no_engine_and_whole_markers(runs):
    drawn = plots.test(runs["measured"])[0]
    assert "measured" in drawn.get_suptitle() and "engine" not in drawn.get_suptitle()
    assert all(not line.get_clip_on() for axes in drawn.axes for line in axes.get_lines() if line.get_marker() == "o")


def test_the_colour_of_a_test_is_that_of_its_void_ratio_in_the_bar(runs):
    drawn = plots.e_p_paths({"cv": runs["cv"], "shear": runs["shear"]})
    bar = next(axes for axes in drawn.axes if axes.get_label() == "<colorbar>")
    scale = bar.collections[-1].norm if bar.collections else None
    start = [float(run["void_ratio"][0]) for run in (runs["cv"], runs["shear"])]
    ends = [line.get_color() for line in drawn.axes[0].get_lines() if line.get_marker() not in ("None", "")]
    expected = [frame.ORDERED((e - min(start)) / (max(start) - min(start))) for e in start]
    np.testing.assert_allclose(ends, expected, atol=0.01)
    assert scale is None or scale.vmin <= min(start)


def test_the_equation_does_not_set_the_scale_where_contacts_are_few(runs):
    spiked = runs["shear"].copy(deep=True)
    spiked["stress_sff_by_volume"].values[5] *= 50.0
    drawn, plain = path_figures.shear(spiked)[0], path_figures.shear(runs["shear"])[0]
    love = 1e-3 * runs["shear"]["stress"].values[:, 0, 2]
    assert drawn.axes[0].get_ylim()[1] < 1.6 * love.max()
    assert [text.get_text() for text in drawn.axes[0].texts] == ["the equation leaves the frame"]
    assert not plain.axes[0].texts


def test_a_liquefied_test_has_panels_against_accumulated_strain(runs):
    run = runs["cycles"]
    axes = path_figures.cycles(run)[0].axes[3]
    assert axes.get_xlabel() == "accumulated axial strain (%)"
    np.testing.assert_allclose(axes.get_lines()[0].get_xdata(), 100 * run.lab.accumulated_strain())
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), run.lab.pore_pressure_ratio())


def test_a_calibration_says_that_initial_values_are_free(runs):
    drawn = draw("calibration", runs, None)
    assert drawn.legends[0].get_title().get_text() == FREE


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("sand-void_ratio0.62", "sand, void ratio 0.62"),
        ("fine-sand-void_ratio0.62-s12", "fine-sand, void ratio 0.62, seed 12"),
        ("sand-p300kPa", "sand, 300 kPa"),
        ("sand-friction0.4-rolling_friction0.1", "sand, friction 0.4, rolling friction 0.1"),
        ("dense", "dense"),
    ],
)
def test_names_of_specimens_are_readable(name, text):
    assert spell_out(name) == text


def test_the_names_of_equations_lie_inside_their_panel(runs):
    drawn = sff_figures.family(runs["cv"])[0]
    FigureCanvasAgg(drawn).draw()
    panel = drawn.axes[1]
    frame_of_panel = panel.get_window_extent()
    assert len(panel.texts) == 9
    for text in panel.texts:
        box = text.get_window_extent()
        assert frame_of_panel.x0 < box.x0 and box.x1 < frame_of_panel.x1, text.get_text()


def test_a_measured_test_is_on_no_engine(measured, runs):
    assert str(lk.Run(measured)).startswith("Run(cr, measured in a laboratory, complete")
    assert "cv on yade" in str(lk.Run(runs["cv"]))
