"""Mixed control: six components, refusals, the full stiffness of the cell, and an elastic cell under mixed control."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.micro.tensors import to_six, to_tensor
from labkit.paths.control import Control
from labkit.paths.element_tests import NORMAL, SHEAR_XZ, StressRotation
from labkit.paths.step import Here, Step, StrainReached
from labkit.servo import correction as servo
from labkit.servo.plan import correcting_of, velocity_gradient


def isotropic(bulk, shear):
    """Isotropic elastic stiffness in Mandel notation."""
    delta = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return 2.0 * shear * np.eye(6) + (bulk - 2.0 * shear / 3.0) * np.outer(delta, delta)


def test_normal_and_tensor_forms_are_the_same():
    short = Control([[1, 0, 0], [0, 1, 0]], np.eye(3)[:, :2], [1.0, 2.0])
    long = Control(NORMAL[:2], NORMAL[:2], [1.0, 2.0])
    assert np.array_equal(short.measure, long.measure) and np.array_equal(short.free, long.free)
    assert short.coaxial and short.components == 3


def test_a_shear_stress_counts_both_components():
    control = Control([SHEAR_XZ], [SHEAR_XZ], [5.0])
    sigma = np.array([[1.0, 0.2, 7.0], [0.2, 2.0, 0.3], [7.0, 0.3, 3.0]])
    assert control.measure @ to_six(sigma) == pytest.approx([7.0])
    assert control.names == ("sigma_xz",) and control.components == 6 and control.isochoric


@pytest.mark.parametrize(
    ("measure", "free", "said"),
    [
        ([[0, 0, 1]], [[0], [0], [0]], "the stress sigma_zz is held, but"),
        ([SHEAR_XZ], NORMAL[2:], "sigma_xz"),
        ([[1, 0, 0], [2, 0, 0]], np.eye(3)[:, :2], "cannot be set independently"),
    ],
)
def test_an_impossible_control_names_the_stress(measure, free, said):
    with pytest.raises(InputError, match=said):
        Control(measure, free, np.ones(len(measure))).require_possible()


def test_more_than_six_conditions_are_refused():
    with pytest.raises(InputError, match="with k held stresses"):
        Control(np.zeros((7, 3, 3)), np.zeros((7, 3, 3)), np.zeros(7))


def test_the_stiffness_is_that_of_affine_motion(sheared_state):
    """Every contact strained affinely, by hand, gives the same stress increment as the six by six stiffness."""
    snapshot = sheared_state.snapshot()
    scene, radius, contacts = snapshot.scene, snapshot.radius, snapshot.contacts
    a, b = radius[contacts.grain].T
    branch = contacts.branch_length(radius)[:, None] * contacts.normal
    kn, kt = scene.normal_stiffness(a, b), scene.tangential_stiffness(a, b)
    rng = np.random.default_rng(3)
    strain = rng.normal(size=(3, 3))
    strain += strain.T
    relative = branch @ strain
    along = np.einsum("ci,ci->c", relative, contacts.normal)
    force = kn[:, None] * along[:, None] * contacts.normal
    force += kt[:, None] * (relative - along[:, None] * contacts.normal)
    stress = branch.T @ force / snapshot.volume
    C = servo.cell_stiffness(snapshot, 6) - servo.FLOOR * snapshot.young_modulus * np.eye(6)
    np.testing.assert_allclose(C, C.T, rtol=1e-12, atol=1e-12 * C.max())
    expected = 0.5 * (stress + stress.T)
    np.testing.assert_allclose(to_tensor(C @ to_six(strain)), expected, atol=1e-11 * np.abs(expected).max())
    block = servo.cell_stiffness(snapshot)
    assert np.array_equal(block, servo.cell_stiffness(snapshot, 6)[:3, :3])


@pytest.mark.parametrize("softer", [1.0, 0.2])
def test_an_elastic_cell_follows_rotating_stresses(softer):
    path = StressRotation(pressure=0.3e6, strain=0.1, rate=10.0)
    dt, interval = 1.2e-7, servo.STANDARD.interval
    C = isotropic(6e7, 4e7)
    step_of_path = next(iter(path.steps_from(Here())))
    stress, L, errors = np.eye(3) * 0.3e6, np.zeros((3, 3)), []
    steps = int(path.strain / (path.rate * dt))
    every = 20  # the cell is corrected at every interval of a coarser clock, to keep the test short
    for step in range(0, steps, interval * every):
        accumulated_strain = path.rate * dt * step
        L = velocity_gradient(step_of_path, path.rate, dt * every, stress, C, L, accumulated=accumulated_strain)
        stress = stress - to_tensor(softer * C @ to_six(L)) * interval * dt * every
        errors.append(np.abs(stress - path.stress_at(accumulated_strain)).max())
    assert max(errors) < 0.01 * 0.3e6


def test_isochoric_control_keeps_the_volume():
    """Simple shear with sigma_yz held by the strain rate yz: nothing changes the volume, to the last digits."""
    sheared, yz = (
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
        np.array([[0.0, 0, 0], [0, 0, 0.5], [0, 0.5, 0]]),
    )
    control, cell, L, dt = Control([yz], [yz], [1e5]), np.eye(3), np.zeros((3, 3)), 1e-6
    step = Step(sheared, control, StrainReached(1.0))
    for _ in range(2000):
        L = velocity_gradient(step, 100.0, dt, np.zeros((3, 3)), isotropic(6e7, 4e7), L)
        cell = cell + dt * L @ cell
    assert abs(np.linalg.det(cell) - 1.0) < 1e-11
    limit = correcting_of(step, 100.0, isotropic(6e7, 4e7), dt, servo.STANDARD).limit
    assert to_six(L)[3] == pytest.approx(-limit)  # the stress stays zero, so the servo strains as fast as it may
    assert lk.Control is Control
