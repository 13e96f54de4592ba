"""The CV test in LAMMPS compared with the `spring_dashpot` law on the `fused` engine."""

import dataclasses
import shutil

import numpy as np
import pytest

import labkit
from analysis.speed_error.lammps import shear_in_lammps
from benchmarks.lammps import size_classes
from labkit.engines.fused import FusedEngine
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.paths.standard import ConstantVolume
from labkit.servo.plan import prescribed_gradient

pytestmark = pytest.mark.long

LAMMPS = shutil.which("lmp")
needs_lammps = pytest.mark.skipif(LAMMPS is None, reason="LAMMPS (lmp) is not installed")
RATE, STRAIN, RECORDS, SETTLE = 100.0, 0.02, 2, 3000


@pytest.fixture(scope="module")
def specimen():
    """About 300 grains at e = 0.67 with the `spring_dashpot` law."""
    scene = Scene(law="spring_dashpot")
    return labkit.make_specimen(labkit.Recipe(0.67, 0.15, grains=300), scene)


def invariants(stress):
    """p in Pa and q/p of stress (record, 3, 3)."""
    p = np.trace(stress, axis1=1, axis2=2) / 3
    return p, (stress[:, 2, 2] - 0.5 * (stress[:, 0, 0] + stress[:, 1, 1])) / p


def without_tangential_forces(state, found):
    """Stress (record, 3, 3) of the same test on `fused`, from a state without tangential forces, as in LAMMPS."""
    nothing = np.zeros_like(state.tangential_force)
    engine = FusedEngine(state.replace(tangential_force=nothing, rolling_moment=nothing, time_step=found.time_step))
    engine.advance(SETTLE, np.zeros((3, 3)))
    stress = [engine.stress()]
    for _ in range(RECORDS):
        engine.advance(found.steps // RECORDS, prescribed_gradient(ConstantVolume(RATE), found.time_step))
        stress.append(engine.stress())
    return np.array(stress)


def sheared(state, beta, rolling_friction=0.1):
    """The specimen with other dashpots and rolling limit, and its LammpsShear."""
    scene = dataclasses.replace(state.scene, beta_n=beta, beta_t=beta, rolling_friction=rolling_friction)
    state = state.replace(scene=scene)
    return state, shear_in_lammps(LAMMPS, state, RATE, STRAIN, RECORDS, SETTLE)


@needs_lammps
@pytest.mark.parametrize("beta, tolerance", [(0.2, 0.02), (0.02, 0.01)])
def test_strength_and_pressure_agree_with_the_spring_dashpot_law(specimen, beta, tolerance):
    """p agrees to 0.3 %; q/p at 1 and 2 % strain is 1 % low with dashpots of 0.2, 0.2 to 0.5 % low with 0.02.

    LAMMPS applies the friction limit to the dashpots too; half of the difference arises while the specimen settles.
    """
    state, found = sheared(specimen, beta)
    (p, ratio), (p_paper, ratio_paper) = invariants(found.stress), invariants(without_tangential_forces(state, found))
    np.testing.assert_allclose(found.axial_strain, np.linspace(0.0, STRAIN, RECORDS + 1), atol=1e-12)
    np.testing.assert_allclose(p, p_paper, rtol=0.006)
    np.testing.assert_allclose(ratio[1:], ratio_paper[1:], rtol=tolerance)
    assert ratio[-1] > 0.7


@needs_lammps
def test_a_settled_specimen_keeps_its_pressure_within_three_per_cent(specimen):
    found = shear_in_lammps(LAMMPS, specimen, 1e4, 1e-3, 1)
    (p, ratio), (before, _) = invariants(found.stress), invariants(FusedEngine(specimen).stress()[None])
    assert abs(p[0] / before[0] - 1) < 0.03 and abs(ratio[0]) < 0.1


@needs_lammps
def test_the_cell_keeps_its_volume_and_reaches_the_strain(specimen):
    found = shear_in_lammps(LAMMPS, specimen, 1000.0, 0.3, 3, settle=0)
    assert np.abs(found.volume / specimen.volume - 1).max() < 1e-12
    np.testing.assert_allclose(found.axial_strain, [0.0, 0.1, 0.2, 0.3], atol=1e-12)
    assert found.steps % 3 == 0 and found.time_step <= specimen.time_step and found.seconds > 0.0


@needs_lammps
def test_what_lammps_cannot_do_is_refused(specimen):
    with pytest.raises(InputError, match="beta_n"):
        state = specimen.replace(scene=dataclasses.replace(specimen.scene, beta_n=0.0))
        shear_in_lammps(LAMMPS, state, RATE, STRAIN, RECORDS)
    with pytest.raises(InputError, match="rotated"):
        shear_in_lammps(LAMMPS, specimen.replace(cell=specimen.cell @ [[1, 0, 0], [0.1, 1, 0], [0, 0, 1]]), 1, 1, 1)
    with pytest.raises(InputError, match="records"):
        shear_in_lammps(LAMMPS, specimen, RATE, STRAIN, 0)
    with pytest.raises(PhysicsError, match="exit status"):
        shear_in_lammps(shutil.which("false"), specimen, RATE, STRAIN, RECORDS)


def test_every_grain_is_near_the_middle_of_its_class():
    radius = np.linspace(0.8, 1.2, 101)
    kind, middle = size_classes(radius, 8)
    assert np.abs(radius - middle[kind]).max() <= 0.025 + 1e-12 and set(kind) == set(range(8))
    kind, middle = size_classes(np.full(3, 0.7), 2)
    np.testing.assert_array_equal(middle[kind], 0.7)
