"""The default strain rate follows the grains of a scene; a rate that is given is kept."""

import dataclasses
import json
import warnings

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.micro.indicators import inertial_number
from labkit.paths.rates import at_rate, default_rate, on_grains, rate_of
from labkit.paths.registry import PATHS, make_path
from labkit.paths.standard import Biaxial, Consolidation
from labkit.records.limits import INERTIAL_LIMIT, expected_inertial_number, rate_warning

pytestmark = pytest.mark.slow

TABLE_1 = {"cv": 10.0, "cr": 10.0, "cp": 10.0, "cyclic_cp": 10.0, "isoc": 5.0, "isod": 2.5}
RECIPE = lk.Recipe(0.67, grains=150)


@pytest.fixture(scope="module")
def state():
    return lk.make_specimen(RECIPE, progress=False)


@pytest.mark.parametrize("name", TABLE_1)
def test_table_1_has_exactly_the_standard_rate(name):
    for scene in (Scene(), Scene(friction=0.1), Scene(young_modulus=70e9), Scene(law="spring_dashpot")):
        assert default_rate(PATHS[name], scene) == TABLE_1[name]
        assert on_grains(make_path(name), scene).rate == TABLE_1[name]
    assert on_grains(Consolidation(pressure=1e5), Scene()).rate == on_grains(Biaxial(), Scene()).rate == 5.0
    assert on_grains(Biaxial(stress_x=2e5), Scene()).stress_x == 2e5


@pytest.mark.parametrize("name", TABLE_1)
@pytest.mark.parametrize(
    "scene", [Scene(mean_diameter=1e-3), Scene(density=600.0), Scene(mean_diameter="1 um", density=9e3)]
)
def test_other_grains_have_the_inertial_number_of_table_1_at_the_same_pressure(name, scene):
    def number(scene):
        rates = default_rate(PATHS[name], scene) * np.diag(PATHS[name].direction)
        return inertial_number(rates, 0.3e6, scene.mean_diameter, scene.density)

    assert np.isclose(number(scene), number(Scene()), rtol=1e-12)


def test_a_given_rate_is_kept():
    path = make_path("cp", {"rate": 7.0, "pressure": "50 Pa"})
    assert on_grains(path, Scene(mean_diameter=1e-3)) is path
    assert at_rate(path, 3.0) == make_path("cp", {"rate": 3.0, "pressure": "50 Pa"})
    with pytest.raises(InputError, match=r"^rate is missing: give a rate") as error:
        rate_of(make_path("cv"))
    assert error.value.field == "rate"


def test_a_numeric_default_of_a_user_defined_path_is_kept():
    @dataclasses.dataclass(frozen=True)
    class Slow(lk.Path):
        rate: float = lk.parameter(0.5, unit="1/s", help="axial strain rate")

        name = "slow"

    assert on_grains(Slow(), Scene(mean_diameter=1e-3)).rate == default_rate(Slow, Scene(density=1e3)) == 0.5


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_a_test_of_coarse_grains_is_as_quasi_static_as_one_of_table_1(engine, state):
    """The specimens are similar: same random numbers, same E, same mean stress."""
    coarse = lk.make_specimen(RECIPE, Scene(mean_diameter=1e-3), progress=False)
    path = lk.paths.ConstantVolume(strain=0.004)
    runs = [lk.run(one, path, engine=engine, snapshots=0, progress=False) for one in (state, coarse)]
    assert [run.path.rate for run in runs] == [10.0, 10.0 * 0.17e-3 / 1e-3]
    numbers = [run.data["inertial_number"].values[1:] for run in runs]
    assert numbers[0].max() < INERTIAL_LIMIT
    np.testing.assert_allclose(numbers[1], numbers[0], rtol=0.05)


def test_the_command_line_uses_the_rate_of_the_grains(state, tmp_path, labkit_command):
    coarse = lk.make_specimen(RECIPE, Scene(mean_diameter=1e-3), file=tmp_path / "s.state.nc", progress=False)
    common = ["--strain", 0.002, "--engine", "fused", "--snapshots", 0]
    for settings, factor in ((["--settings", "quick"], 4.0), ([], 1.0), (["--rate", 3], 3.0 / 1.7)):
        file = tmp_path / f"{factor}.run.nc"
        done = labkit_command("run", "cv", "s.state.nc", *common, *settings, "-o", file, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        with netCDF4.Dataset(file) as run:
            assert np.isclose(json.loads(run.path_parameters)["rate"], 1.7 * factor, rtol=1e-12)
    assert coarse.scene.mean_diameter == 1e-3


@pytest.mark.parametrize(("name", "rate"), [("cv", 10.0), ("cp", 10.0), ("isoc", 5.0)])
def test_the_expected_inertial_number_is_the_recorded_one(name, rate, state):
    path = make_path(name, {"rate": rate, "strain": 0.002}).starting_at(0.4e6)
    run = lk.run(state, path, snapshots=0, progress=False, record_strain=2e-4)
    pressure = float(run.data.lab.mean_stress()[0])
    recorded = run.data["inertial_number"].values[1]
    assert np.isclose(expected_inertial_number(path, state.scene, pressure), recorded, rtol=0.3)


def test_a_rate_that_is_too_high_is_reported_at_the_start(state, tmp_path, labkit_command):
    path = lk.paths.ConstantMeanStress(pressure=0.4e6, strain=0.004, rate=60.0)
    assert rate_warning(on_grains(lk.paths.ConstantMeanStress(pressure=0.4e6), state.scene), state) is None
    message = rate_warning(path, state)
    assert "60 1/s the inertial number will be about 0.001, above the limit 0.0003" in message
    slower = float(message.split("reduce the rate to ")[1].split()[0])
    assert rate_warning(at_rate(path, slower), state) is None and slower > 10.0
    with pytest.warns(UserWarning, match="60 1/s"):
        run = lk.run(state, path, snapshots=0, progress=False)
    assert "inertial number" in [limit.name for limit in run.exceeded]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lk.run(state, at_rate(path, slower), snapshots=0, progress=False)
    lk.write_state(tmp_path / "s.state.nc", state)
    options = ["--pressure", "0.4 MPa", "--strain", 0.004, "--rate", 60, "--engine", "fused"]
    done = labkit_command("run", "cp", "s.state.nc", *options, "-o", "r.run.nc", cwd=tmp_path)
    assert done.returncode == 0 and message in done.stdout + done.stderr
