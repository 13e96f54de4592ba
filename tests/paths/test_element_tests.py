"""The loading paths beyond the paper's six, on real grains: held quantities, reversals, ends and resumption."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.grains.lattice import tilt
from labkit.micro.tensors import symmetric, to_six
from labkit.paths import cycles, stress_reversals
from labkit.paths import element_tests as tests
from labkit.paths.rates import on_grains
from tests.killed import run_killed

pytestmark = pytest.mark.slow

P = 0.3e6
STRESS_PATHS = {
    "constant axial stress": tests.ConstantAxialStress(pressure=P, strain=0.02),
    "extension at constant axial stress": tests.ConstantAxialStress(pressure=P, strain=-0.02),
    "extension at constant p": lk.paths.ConstantMeanStress(pressure=P, strain=-0.02),
    "extension at constant radial stress": lk.paths.ConstantRadialStress(pressure=P, strain=-0.02),
    "true triaxial": tests.TrueTriaxial(pressure=P, b=0.5, strain=0.02),
    "true triaxial, b = 1": tests.TrueTriaxial(pressure=P, b=1.0, strain=0.02),
    "plane strain": tests.PlaneStrain(pressure=P, strain=0.02),
    "simple shear": tests.SimpleShear(pressure=P, strain=0.03),
    "pure shear": tests.SimpleShear(pressure=P, strain=0.03, spin=False),
    "rotation of principal stresses": tests.StressRotation(pressure=P, strain=0.03),
    "drained cycles": cycles.DrainedCycles(pressure=P, amplitude=1e5, cycles=1),
}


@pytest.fixture(scope="module")
def specimen():
    return lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=300), lk.Scene(law="spring_dashpot"), progress=False)


@pytest.mark.parametrize("name", STRESS_PATHS)
def test_stresses_follow_their_targets(specimen, name):
    path = on_grains(STRESS_PATHS[name], specimen.scene)
    run = lk.run(specimen, path, progress=False)
    control, data = path.control(), run.data
    accumulated_strain = path.rate * data["time"].values
    judged = accumulated_strain > 0.005
    stress = to_six(symmetric(data["stress"].values))[judged]
    target = np.array([control.at(t) for t in accumulated_strain[judged]])
    error = (stress @ control.measure.T - target) / data.lab.mean_stress().values[judged, None]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 0.005
    assert np.abs(error).max() < 0.02
    assert np.abs(data["energy_balance_error"].values).max() < 1e-3
    assert all(finding.holds for finding in lk.verify(run) if finding.name.startswith("held"))
    if path.strain < 0.0:
        assert data.lab.q().values[-1] < 0.0 and data.lab.lode_angle().values[-5:].mean() > 45.0


def test_constant_volume_is_exact_in_shear(specimen):
    run = lk.run(specimen, tests.SimpleShearConstantVolume(strain=0.05), progress=False)
    volume = run.data["volume"].values
    assert np.abs(volume / volume[0] - 1.0).max() < 1e-10
    assert run.data["stress"].values[-1, 0, 2] > 0.0  # shear stress and shear strain have the same sign
    assert run.data["strain"].values[-1, 0, 2] > 0.0


OPTIONS = {"progress": False, "save_every": 20, "record_strain": 5e-3, "snapshots": 0}


@pytest.mark.filterwarnings("ignore:the inertial number 0.0009 is above the limit")
@pytest.mark.parametrize(
    ("path", "number"),
    [
        (tests.SimpleShear(pressure=P, strain=0.6, rate=300.0), None),
        (cycles.UndrainedCycles(amplitude=20e3, cycles=20, rate=20.0), None),
        (lk.paths.ConstantVolume(strain=0.4), 9e-4),
    ],
)
def test_a_killed_run_resumes_to_the_same_bits(specimen, path, number, tmp_path):
    """The cases: a cell tilted past one half by shear, a path that reverses at a stress, and an inertial number."""
    options = {**OPTIONS, "inertial_number": number}
    whole = lk.run(specimen, path, **options)
    file = tmp_path / "r.run.nc"
    run_killed(3, specimen, path, file, options)
    assert not lk.open_run(file).attrs["complete"]
    again = lk.run(specimen, path, file=file, **options)
    for name in ("stress", "strain", "cell", "void_ratio"):
        assert np.array_equal(again.data[name].values, whole.data[name].values)
    if path.name == "simple_shear":
        assert tilt(whole.data["cell"].values[-1]) < 0.5 and whole.data["strain"].values[-1, 0, 2] > 0.2


def test_reloading_visits_its_stresses(specimen):
    levels = (1.4e6, 1.0e6, 1.6e6)  # the specimen is at 1.1 MPa
    for path, of in (
        (stress_reversals.IsotropicReloading(pressures=levels), lambda data: data.lab.mean_stress().values),
        (stress_reversals.OedometerReloading(stresses=levels), lambda data: data["stress"].values[:, 2, 2]),
    ):
        run = lk.run(specimen, path, progress=False)
        stress = of(run.data)
        turns = [stress[0], *stress[1:-1][np.diff(np.sign(np.diff(stress))) != 0], stress[-1]]
        np.testing.assert_allclose(turns[-3:], levels, rtol=0.01)
        assert run.complete


def test_the_lode_angle_is_an_alternative_to_b():
    assert tests.TrueTriaxial(lode_angle=0.0).ratio == 0.0
    assert tests.TrueTriaxial(lode_angle=30.0).ratio == pytest.approx(0.5)
    assert tests.TrueTriaxial(lode_angle=60.0).ratio == pytest.approx(1.0)
    with pytest.raises(InputError, match="lode_angle and b are both given"):
        tests.TrueTriaxial(b=0.5, lode_angle=30.0)


@pytest.mark.parametrize("stresses", [(1e6, 2e6), (1e6, 1e6), (), (-1.0,)])
def test_stresses_that_do_not_alternate_are_refused(stresses):
    with pytest.raises(InputError, match=r"stresses|alternate"):
        stress_reversals.OedometerReloading(stresses=stresses)


def test_every_path_is_in_the_registry_with_a_description():
    for name in lk.paths.PATHS:
        assert lk.paths.PATHS[name].name == name and lk.paths.PATHS[name].__doc__


def test_every_path_is_found_beside_those_of_the_paper():
    for kind in lk.paths.PATHS.values():
        assert getattr(lk.paths, kind.__name__) is kind and kind.__name__ in dir(lk.paths)
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = lk.paths.Nothing
