"""Whatever a user asks of whatever run gives a value, a figure or one sentence; and two ways to ask give one answer."""

import dataclasses
import functools
import re
import shutil

import matplotlib.pyplot as plt
import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.files.netcdf import extend_netcdf
from labkit.model import Model, drive, isotropic_state
from labkit.paths.cycles import UndrainedCycles
from labkit.paths.ending import Cause, Ending, Endings, endings_of
from labkit.results.info import describe_file, run_summary
from tests.results.user_runs import RUNS, cell, columns, make_runs, members

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return make_runs(tmp_path_factory.mktemp("runs"))


@pytest.mark.parametrize("name", RUNS)
def test_every_cell_is_a_value_a_figure_or_one_sentence(name, files, tmp_path):
    run, fallen = lk.Run.open(files[name]), {}
    for asked, ask in {**columns(run), **members(run)}.items():
        try:
            cell(lambda ask=ask: ask(files[name], tmp_path))
        except Exception as error:
            fallen[asked] = f"{type(error).__name__}: {error}"
    assert not fallen


@pytest.mark.parametrize("name", ["extension", "shear", "continued", "cycles", "model", "measured"])
def test_a_figure_draws_what_the_accessor_returns(name, files):
    run = lk.Run.open(files[name])
    lab = run.data.lab
    expected = {"q": lab.q(), "q/p": lab.stress_ratio(), "axial_strain": run.data["axial_strain"]}
    if lab.is_undrained:
        expected |= {"r_u": lab.pore_pressure_ratio(), "pore_pressure": lab.pore_pressure()}
    for variable, values in expected.items():
        (line,) = run.plot("records", variable=variable).axes[0].get_lines()
        factor = np.nanmax(np.abs(line.get_ydata())) / np.nanmax(np.abs(values))
        np.testing.assert_allclose(line.get_ydata(), factor * values, rtol=1e-9, atol=1e-12)
        assert factor == pytest.approx(1.0 if values.attrs["units"] == "1" else 1e-3 if factor > 1e-4 else 1e-6)
        np.testing.assert_array_equal(lab.quantity(variable), values)
    if name == "continued":
        assert abs(float(lab.pore_pressure_ratio()[0])) > 1e-3


def test_summaries_of_compression_and_extension_have_the_peak_of_each(files):
    summary = lk.open_runs([files["compression"], files["extension"]]).runs.summary()
    for k, name in enumerate(("compression", "extension")):
        lab = lk.Run.open(files[name]).data.lab
        ratio = np.abs(lab.stress_ratio().values)
        assert float(summary["peak_stress_ratio"][k]) == ratio.max() > 0.2
        assert float(summary["strain_at_peak"][k]) == float(lab.strain()[ratio.argmax()]) != 0.0
        assert float(summary["peak_friction_angle"][k]) > 5.0
        assert f"largest {ratio.max():.3g}" in lk.Run.open(files[name])._repr_html_()


def test_a_measured_test_and_a_prediction_are_in_a_summary(files):
    summary = lk.open_runs([files["compression"], files["measured"], files["model"]]).runs.summary()
    assert np.isnan(summary["steps"][1]) and summary["steps"][0] > 0
    assert (summary["peak_stress_ratio"] > 0.1).all()


def test_a_stop_at_a_coordinate_is_named_everywhere(files):
    run = lk.Run.open(files["stopped"])
    reached, before = np.abs(run.data["axial_strain"].values[[-1, -2]])
    assert reached > 0.005 >= before
    (met,) = run.met_conditions
    assert re.fullmatch(
        r"it ended when abs\(axial_strain\) > 0.5 % \(.* = 0\.\d+ %; .* = 0.\d+ % one record before\)", met
    )
    for text in (repr(run), run._repr_html_(), describe_file(files["stopped"])):
        assert "ended when abs(axial_strain)" in text


def test_records_can_be_interpolated_along_what_the_accessor_computes(files):
    runs = lk.open_runs([files["compression"], files["extension"]])
    at = runs.runs.interpolate([0.002, 0.004], along="accumulated_strain")
    np.testing.assert_allclose(at["axial_strain"].values, [[0.002, 0.004], [-0.002, -0.004]], rtol=1e-3)
    with pytest.raises(InputError, match="at common values of accumulated_strain"):
        at.lab.q()


def test_arrays_choose_snapshots(files):
    lab = lk.Run.open(files["compression"]).data.lab
    assert [each.number for each in lab.snapshots(np.array([0, 1]))] == [0, 1]
    assert list(lab.snapshots([])) == [] and len(list(lab.snapshots())) == 3
    with pytest.raises(InputError, match="a number from 0 to 2"):
        lab.snapshot(99)


@pytest.mark.parametrize("record_strain", [0.0021, 0.0023, 0.0025])
def test_every_reversal_is_recorded_and_created_energy_has_one_value_per_record(record_strain, dense, tmp_path):
    """However the regular records lie beside the reversals and the end of the path."""
    file = tmp_path / "r.run.nc"
    path = UndrainedCycles(ratio=0.1, cycles=3)
    run = lk.run(dense, path, file=file, record_strain=record_strain, progress=False)
    ratio = run.data.lab.stress_ratio().values
    turns = ratio[np.abs(ratio) >= 0.1 - 1e-3]
    assert np.sign(turns).tolist() == [1.0, -1.0] * 3
    with netCDF4.Dataset(file) as data:
        assert len(data["checkpoint"]["ratcheting_work"]) == len(ratio)


@pytest.fixture(scope="module")
def dense():
    made = lk.make_specimen(lk.Recipe(void_ratio=0.62, grains=200), progress=False)
    return lk.consolidate(made, "200 kPa", progress=False)


def test_a_stop_in_the_middle_of_a_step_does_not_claim_the_condition_of_the_step(dense, tmp_path):
    """The step ends at q/p > 5, which is never met; the run ends within it."""
    (tmp_path / "p.yaml").write_text(
        "path: steps\npressure: 200 kPa\n"
        "steps:\n  - {strain: {zz: 1 %}, stress: {xx: 0, yy: 0}, until: q/p > 5, records: 10}\n"
    )
    run = lk.run(dense, lk.read_path(tmp_path / "p.yaml"), stop_when="axial_strain > 0.4 %", progress=False)
    (met,) = run.met_conditions
    assert met.startswith("it ended when axial_strain > 0.4 %")


def test_every_end_is_a_value_in_the_file(files):
    """What ended a run, as it was when it happened."""
    mixed = lk.Run.open(files["mixed"]).endings
    condition, end = mixed.last
    assert (mixed.met, condition.step, condition.cause, condition.over) == (1, 1, "condition", False)
    ratio = lk.Run.open(files["mixed"]).data.lab.stress_ratio().values
    at = int(np.argmax(ratio > 0.1))
    assert condition.reached == f"q/p = {ratio[at]:.4g}" and condition.before == f"q/p = {ratio[at - 1]:.4g}"
    assert (end.step, end.cause, end.over) == (2, "strain", True)
    for name, cause in (("compression", "strain"), ("stopped", "stop_when"), ("cycles", "stress"), ("model", "strain")):
        assert lk.Run.open(files[name]).endings.last[-1].cause == cause
    for name in ("unfinished", "measured"):
        assert lk.Run.open(files[name]).endings.last == ()


def test_a_file_of_an_earlier_version_says_only_what_it_stores(files, tmp_path):
    old = shutil.copy(files["stopped"], tmp_path / "old.run.nc")
    with extend_netcdf(old, 0) as data:
        del data.endings
        data.ended_because = "the strain limit was reached"
    run = lk.Run.open(old)
    assert run.met_conditions == () and run.endings.reason == run.ended_because == "the strain limit was reached"


def test_a_condition_that_is_never_met_is_named(dense):
    run = lk.run(dense, lk.paths.ConstantVolume(strain=0.002), stop_when="q/p > 5", progress=False)
    assert run.met_conditions == ("q/p > 5 was never met",) and "q/p > 5 was never met" in repr(run)


UNDRAINED_AFTER_DRAINED = """\
path: steps
pressure: 200 kPa
steps:
  - {strain: {zz: 0.3 %}, stress: {xx: 0, yy: 0}, records: 4}
  - {strain: {zz: 1 %, xx: -0.5 %, yy: -0.5 %}, until: abs(r_u) > 0.02, records: 20}
"""


def test_r_u_counts_from_the_start_of_the_undrained_step(dense, tmp_path):
    (tmp_path / "p.yaml").write_text(UNDRAINED_AFTER_DRAINED)
    run = lk.run(dense, lk.read_path(tmp_path / "p.yaml"), progress=False)
    (met,) = run.met_conditions
    assert met.startswith("step 2 ended when abs(r_u) > 0.02")
    ratio, p = run.data.lab.pore_pressure_ratio().values, run.data.lab.mean_stress().values
    start = np.flatnonzero(run.data["path_step"].values == 1)[-1]
    assert np.isnan(ratio[:start]).all()
    np.testing.assert_allclose(ratio[start:], 1.0 - p[start:] / p[start], atol=1e-12)
    assert abs(ratio[-1]) > 0.02 >= np.nanmax(np.abs(ratio[:-1]))
    np.testing.assert_allclose(run.state.undrained_stress, run.data["stress"].values[start].ravel())


def test_a_quantity_without_meaning_is_refused_in_the_same_words_everywhere(files, dense, tmp_path):
    """The pore pressure of a drained test, and the cycles of a monotonic one."""
    run, path = lk.Run.open(files["compression"]), lk.paths.ConstantRadialStress(pressure="200 kPa", strain=0.01)
    drained = (
        "this run of cr is drained: its volume changes, so it has no pore pressure; give a test at constant volume"
    )
    for ask in (
        run.data.lab.pore_pressure_ratio,
        lambda: run.data.lab.quantity("r_u_axial"),
        lambda: run.plot("records", variable="r_u"),
        lambda: lk.run(dense, path, stop_when="r_u > 0.05", file=tmp_path / "r.run.nc", progress=False),
        lambda: drive(Model(), path, isotropic_state(Model(), 0.67, 2e5), stop_when="r_u > 0.05"),
        lambda: lk.open_runs([files["compression"]]).runs.interpolate([0.01], along="r_u"),
    ):
        with pytest.raises(InputError) as refused:
            ask()
        assert str(refused.value) == drained
    assert not (tmp_path / "r.run.nc").exists()
    for ask in (run.data.lab.cycles, lambda: run.plot("records", variable="cycles")):
        with pytest.raises(InputError, match="this run of cr is monotonic, so it has no cycles"):
            ask()


def test_the_pore_pressure_of_a_measured_triaxial_test_is_what_its_file_says(files):
    lab = lk.Run.open(files["measured"]).data.lab
    np.testing.assert_allclose(lab.pore_pressure(), [0.0, 30e3, 50e3, 60e3], atol=1.0)
    np.testing.assert_allclose(lab.pore_pressure_ratio(), [0.0, 0.3, 0.5, 0.6], atol=1e-4)


def test_records_are_drawn_in_axes_of_the_user_and_campaigns_complete_their_methods(files):
    figure, (left, right) = plt.subplots(1, 2)
    run = lk.Run.open(files["compression"])
    assert (
        run.plot("records", variable="q", ax=left) is figure and run.plot("records", variable="A", ax=right) is figure
    )
    assert len(left.get_lines()) == 1 and len(right.get_lines()) == 6 and not figure.get_suptitle()
    plt.close(figure)
    assert {"q", "quantity", "friction_angle"} <= set(dir(lk.open_runs([files["compression"]]).lab))


UNDRAINED_TWICE = """\
path: steps
pressure: 200 kPa
steps:
  - {strain: {zz: 0.4 %, xx: -0.2 %, yy: -0.2 %}, until: abs(r_u) > 5, records: 4}
  - {strain: {zz: 0.3 %}, stress: {xx: 0, yy: 0}, until: q/p > 9 or Z < 1, records: 3}
  - {strain: {zz: -0.4 %, xx: 0.2 %, yy: 0.2 %}, records: 4}
"""


def test_r_u_of_each_undrained_step_counts_from_its_own_start(dense, tmp_path):
    """Also if the run goes on undrained, from the start of the earlier run, and if undrained steps follow later."""
    (tmp_path / "p.yaml").write_text(UNDRAINED_TWICE)
    path = lk.read_path(tmp_path / "p.yaml")
    first = lk.run(dense, path, file=tmp_path / "first.run.nc", progress=False)
    free = dataclasses.replace(path, pressure=None)
    then = lk.run(first.state, dataclasses.replace(free, order=(0, 1, 2)), progress=False)
    known = [first.data["stress"].values[0], first.data["stress"].values[7]]
    for run, starts in ((first, known), (lk.Run.open(tmp_path / "first.run.nc"), known), (then, [known[1], None])):
        ratio, p = run.data.lab.pore_pressure_ratio().values, run.data.lab.mean_stress().values
        assert run.data["path_step"].values.tolist() == [1] * 5 + [2] * 3 + [3] * 4
        assert np.isnan(ratio[5:7]).all()
        np.testing.assert_allclose(ratio[:5], 1.0 - p[:5] / lk.mean_stress(starts[0]), atol=1e-12)
        np.testing.assert_allclose(ratio[7:], 1.0 - p[7:] / p[7], atol=1e-12)
    assert abs(then.data.lab.pore_pressure_ratio().values[0]) > 0.01
    assert "r_u refers to" in run_summary(then.data) and "r_u refers to" not in run_summary(first.data)


def test_conditions_of_steps_that_are_never_met_are_named(dense, tmp_path):
    (tmp_path / "p.yaml").write_text(UNDRAINED_TWICE)
    run = lk.run(dense, lk.read_path(tmp_path / "p.yaml"), file=tmp_path / "r.run.nc", progress=False)
    said = ("abs(r_u) > 5 was never met in step 1", "q/p > 9 or Z < 1 was never met in step 2")
    assert run.met_conditions == lk.Run.open(tmp_path / "r.run.nc").met_conditions == said
    assert "; ".join(said) in run_summary(run.data)["ended"]
    assert all(any(text == str(finding) for finding in lk.verify(run)) for text in said)


def test_of_many_conditions_never_met_the_number_is_named():
    missed = [Ending(k, Cause.STRAIN, "q/p > 9", over=k == 12) for k in range(1, 13)]
    endings = functools.reduce(Endings.after, missed, Endings())
    assert endings.words("p > 1 MPa") == (
        "the conditions of 12 steps were never met",
        "q/p > 9 was never met in step 12",
        "p > 1 MPa was never met",
    )
    assert endings_of({"endings": endings.to_json(), "complete": 1}) == endings
    assert endings_of({"endings": '{"met": 0, "last": []}', "complete": 1}) == Endings()


def test_the_summary_gives_the_reason_beside_the_condition_that_was_never_met(dense):
    path = UndrainedCycles(amplitude="900 kPa", cycles=2, strain_limit=0.004)
    run = lk.run(dense, path, stop_when="r_u > 0.99", progress=False)
    assert run_summary(run.data)["ended"] == f"r_u > 0.99 was never met; {run.ended_because}"
    assert "strain_limit" in run.ended_because
