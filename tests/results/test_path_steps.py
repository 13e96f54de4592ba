"""Steps of a path file shown as runs of their own: records, snapshots, undrained reference, figures."""

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.errors import InputError
from labkit.paths.steps import Steps
from labkit.paths.variables import increments

pytestmark = pytest.mark.slow

PHASES = (
    increments(stress={"xx": 0.0, "yy": 0.0}, strain={"zz": 0.004}),  # drained
    increments(strain={"zz": 0.003, "xx": -0.0015, "yy": -0.0015}),  # undrained, and on
    increments(strain={"zz": 0.003, "xx": -0.0015, "yy": -0.0015}),
    increments(strain={"xz": 0.004}),  # not axisymmetric
)


@pytest.fixture(scope="module")
def file(tmp_path_factory, soft_specimen):
    file = tmp_path_factory.mktemp("steps") / "r.run.nc"
    path = Steps(pressure=1e5, steps=PHASES, rate=40.0)
    lk.run(soft_specimen, path, file=file, progress=False, snapshots=6, inertial_number=None)
    return file


def test_a_step_begins_with_the_last_record_of_the_step_before(file):
    run = lk.open_run(file)
    number = run["path_step"].values
    parts = [run.lab.step(k) for k in (1, 2, 3, 4)]
    assert sum(part.sizes["time"] - 1 for part in parts) == run.sizes["time"] - 1
    for k, part in enumerate(parts, start=1):
        np.testing.assert_array_equal(part["stress"].values[1:], run["stress"].values[number == k][k == 1 :])
        assert (part["path_step"].values == 1.0).all() and part["path_step_progress"].values[0] == 0.0
        assert part.lab.accumulated_strain().values[0] == 0.0
        for at in range(part.sizes["snapshot"]):
            love = lk.love_stress(part.lab.snapshot(at))
            np.testing.assert_allclose(part["stress"].values[part["record"].values[at]], love, rtol=1e-5, atol=1.0)
    assert [part.lab.axisymmetric for part in parts] == [True, True, True, False] and not run.lab.axisymmetric
    both = run.lab.step("2-3")
    assert both.sizes["time"] == parts[1].sizes["time"] + parts[2].sizes["time"] - 1
    np.testing.assert_array_equal(np.unique(both["path_step"]), [1.0, 2.0])


def test_pore_pressure_of_a_step_counts_from_the_start_of_undrained_loading(file):
    run = lk.open_run(file)
    number, u = run["path_step"].values, run.lab.pore_pressure().values
    for k in (2, 3):
        np.testing.assert_allclose(run.lab.step(k).lab.pore_pressure().values[1:], u[number == k])
    assert run.lab.step(2).lab.pore_pressure().values[0] == pytest.approx(0.0, abs=1e-6)
    assert abs(run.lab.step(3).lab.pore_pressure().values[0]) > 1.0
    with pytest.raises(InputError, match="is drained"):
        run.lab.step(1).lab.pore_pressure()


def test_the_figure_of_an_undrained_step_shows_its_pore_pressure(file, tmp_path):
    run = lk.Run.open(file)
    figure = run.plot("test", step=2)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert "excess pore pressure u (kPa),\nconstant total mean stress" in labels
    assert "r: path steps, step 2, " in figure.get_suptitle()
    assert "excess" not in "".join(axes.get_ylabel() for axes in run.plot("test").axes)  # drained in part
    assert main(["figure", "test", str(file), "--step", "2-3", "--csv", str(tmp_path / "t.csv")]) == 0
    values = np.genfromtxt(tmp_path / "t.csv", delimiter=",", names=True)["pore_pressure_Pa"]
    np.testing.assert_allclose(values, run.data.lab.step("2-3").lab.pore_pressure(), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("step", [0, 5, "3-2", "2-9", "two", -1, 1.5])
def test_a_step_that_is_not_in_the_run_is_refused(file, step):
    with pytest.raises(InputError, match="give 1 to 4, or a range such as 1-4") as error:
        lk.Run.open(file).plot("test", step=step)
    assert (error.value.field, error.value.value) == ("step", step)


def test_a_run_of_another_path_has_no_steps(shear_file):
    with pytest.raises(InputError, match="step is for path files, not for a run of simple_shear"):
        lk.open_run(shear_file).lab.step(1)
