import numpy as np
import pytest

from labkit.bodies.shapes import Rod
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.paths.registry import make_path
from labkit.paths.step import Here
from labkit.servo import correction as servo
from labkit.servo.formula import LOW_PASS
from labkit.servo.plan import velocity_gradient
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import insert_grains
from tests.bodies.clumped import clumped


def test_stiffness_of_a_cubic_crystal_is_its_closed_form():
    """One grain per cell with contacts along the axes: kn/spacing in compression, nothing across."""
    radius, spacing = 85e-6, 168e-6
    state = grains_in_cell(Scene(), np.array([radius]), np.zeros((1, 3)), np.eye(3) * spacing).replace(
        contact_grain=np.zeros((3, 2), int),
        contact_shift=np.eye(3, dtype=int),
        tangential_force=np.zeros((3, 3)),
        rolling_moment=np.zeros((3, 3)),
    )
    kn = Scene().normal_stiffness(radius, radius)
    expected = kn / spacing * np.eye(3) + servo.FLOOR * 0.15e9 * np.eye(3)
    np.testing.assert_allclose(servo.cell_stiffness(state.snapshot()), expected, rtol=1e-12)


def test_stiffness_without_contacts_is_positive_definite():
    spheres = insert_grains(Scene(), Recipe(0.67, side=1e-3))
    for state in (spheres, clumped(spheres, [Rod()])):
        assert np.linalg.eigvalsh(servo.cell_stiffness(state.snapshot(), 6)).min() > 0.0


@pytest.mark.parametrize("softer", [1.0, 0.3, 0.05])
@pytest.mark.parametrize("name", ["cr", "cp"])
def test_the_loop_is_stable_and_its_lag_is_that_of_the_derivation(name, softer):
    """An elastic cell, softer than the upper bound that the servo uses, sheared at 10 1/s."""
    dt, interval = 1.2e-7, servo.STANDARD.interval
    stiffness = np.array([[6.0, 2.0, 2.0], [2.0, 6.0, 2.0], [2.0, 2.0, 6.0]]) * 1e7
    path = make_path(name, {"pressure": 0.5e6, "rate": 10.0})
    step = next(iter(path.steps_from(Here())))
    stress, L = np.eye(3) * 0.499e6, np.zeros((3, 3))
    held = []
    for _ in range(600):
        L = velocity_gradient(step, path.rate, dt, stress, stiffness, L)
        stress = stress - np.diag(softer * stiffness @ np.diag(L)) * interval * dt
        held.append(path.control().measure[:, :3] @ np.diag(stress))
    error = np.array(held) - 0.5e6
    assert np.abs(error[200:]).max() < 0.002 * 0.5e6
    steady = np.diag(L)[0]
    response = path.control().measure[:, :3] @ stiffness @ path.control().free[:3]
    lag = -steady * response.sum(axis=1) * interval * dt / servo.STANDARD.gain
    np.testing.assert_allclose(error[-1], -lag, rtol=0.02, atol=1.0)


def test_rates_are_limited():
    path = make_path("cp", {"pressure": 0.5e6, "rate": 10.0})
    step = next(iter(path.steps_from(Here())))
    L = velocity_gradient(step, path.rate, 1e-7, np.zeros((3, 3)), np.eye(3) * 1e5, np.zeros((3, 3)))
    assert np.abs(np.diag(L)[:2]).max() <= LOW_PASS * path.rate_limit * path.rate * (1 + 1e-12)


def test_the_servo_does_not_change_the_axial_rate():
    for sign in (1.0, -1.0):
        path = make_path("cr", {"pressure": 0.5e6, "rate": 10.0, "strain": sign * 0.4})
        step = next(iter(path.steps_from(Here())))
        L = velocity_gradient(step, path.rate, 1e-7, np.zeros((3, 3)), np.eye(3) * 1e7, np.zeros((3, 3)))
        assert np.isclose(-np.log1p(L[2, 2] * 1e-7) / 1e-7, sign * path.rate)
