"""Runs at a prescribed inertial number."""

import json
from contextlib import nullcontext

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError, LabkitWarning
from labkit.paths.rates import on_grains
from labkit.records.limits import exceeded_in, expected_inertial_number
from labkit.simulation.clock import steps_at

pytestmark = pytest.mark.slow

NUMBER = 1e-3


@pytest.fixture(scope="module")
def specimen():
    return lk.make_specimen(lk.Recipe(void_ratio=0.65, grains=500), engine="fused", progress=False)


@pytest.mark.parametrize(
    ("path", "prescribed"),
    [
        (lk.paths.ConstantVolume(strain=0.03), NUMBER),
        (lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.03), NUMBER),
        (lk.paths.IsotropicCompression(pressure=2e6), 2.5e-4),
    ],
)
def test_the_inertial_number_stays_at_the_prescribed_one(specimen, path, prescribed):
    fast = pytest.warns(LabkitWarning, match="is above the limit 0.0003") if prescribed == NUMBER else nullcontext()
    with fast:
        run = lk.run(specimen, path, inertial_number=prescribed, snapshots=0, progress=False).data
    number = run["inertial_number"].values[2:]
    assert np.median(number) == pytest.approx(prescribed, rel=0.1)
    assert np.quantile(np.abs(number / prescribed - 1.0), 0.9) < 0.3
    interval = np.diff(run["accumulated_strain"].values)
    np.testing.assert_allclose(interval[:-1], interval[0], rtol=1e-9)  # records stay at equal strains
    rate = interval / np.diff(run["time"].values)
    pressure = run.lab.mean_stress().values
    assert rate[1:].min() < 0.9 * rate[1:].max() or np.ptp(pressure) < 0.1 * pressure.mean()
    assert all(finding.holds for finding in lk.verify(lk.Run(run)) if finding.name.startswith("held"))


@pytest.mark.parametrize("asked, factor", [(1e-9, 0.1), (1e-6, 0.1), (0.1, 10.0)])
@pytest.mark.parametrize("engine", ["fused", pytest.param("yade", marks=pytest.mark.yade)])
def test_an_inertial_number_that_is_not_reached_is_said(engine, asked, factor, specimen, tmp_path):
    path, file = lk.paths.ConstantVolume(strain=0.01), tmp_path / "r.run.nc"
    with pytest.warns(UserWarning, match=f"the inertial number {asked:g} is not reached: .* or a rate instead"):
        options = {"engine": engine, "snapshots": 0, "progress": False}
        run = lk.run(specimen, path, inertial_number=asked, file=file, **options)
    number = run.data["inertial_number"].values[1:]
    (missed,) = [one for one in run.exceeded if one.name.startswith("factor between the inertial number")]
    off = max(np.median(number) / asked, asked / np.median(number))
    assert missed.records == len(number) and off <= missed.largest < 3.0 * off
    assert [str(one) for one in exceeded_in(file)] == [str(one) for one in run.exceeded]
    expected = factor * expected_inertial_number(
        on_grains(path, specimen.scene), specimen.scene, float(run.data.lab.mean_stress()[0])
    )
    assert np.median(number) == pytest.approx(expected, rel=0.3)


def test_an_inertial_number_that_is_reached_is_not_warned_of(specimen, recwarn):
    path = lk.paths.ConstantMeanStress(pressure=0.3e6, strain=0.01)
    run = lk.run(specimen, path, inertial_number=2e-4, snapshots=0, progress=False)
    assert not [one for one in run.exceeded if "prescribed" in one.name]
    assert not [one for one in recwarn if "inertial number" in str(one.message)]


def test_whole_steps_end_exactly_at_the_next_stop():
    for wanted in (0.1, 0.73, 1.0, 9.9):
        steps, pace = steps_at(wanted, 857)
        assert pace <= wanted and pace * steps == pytest.approx(857, abs=1e-9) and pace > wanted * (1 - 1 / steps)


def test_a_rate_and_an_inertial_number_exclude_each_other(specimen, tmp_path, labkit_command):
    path = lk.paths.ConstantVolume(strain=0.03, rate=5.0)
    with pytest.raises(InputError, match=r"inertial_number .* excludes a fixed rate"):
        lk.run(specimen, path, inertial_number=NUMBER, progress=False)
    lk.write_state(tmp_path / "s.state.nc", specimen)
    command = ["run", "cv", "s.state.nc", "--engine", "fused", "--strain", 0.01, "--inertial-number", "1e-3"]
    done = labkit_command(*command, "--rate", 5, cwd=tmp_path)
    assert done.returncode == 2 and "inertial-number" in done.stderr
    done = labkit_command(*command, "--settings", "quick", "--snapshots", 0, "-o", "r.run.nc", cwd=tmp_path)
    assert done.returncode == 0 and "0.001 is above the limit 0.0003" in done.stdout + done.stderr
    with netCDF4.Dataset(tmp_path / "r.run.nc") as run:
        assert json.loads(run.path_parameters)["inertial_number"] == 1e-3
