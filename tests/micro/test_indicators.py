import numpy as np

from labkit.micro import indicators
from labkit.micro.contacts import Contacts
from labkit.dem.scene import Scene
from labkit.dem.state import grains_in_cell

NONE = Contacts(np.zeros((0, 2), int), *(np.zeros(s) for s in ((0, 3), 0, 0, (0, 3), (0, 3))))


def test_inertial_number_uses_the_euclidean_norm():
    rate = np.diag([-5.0, -5.0, 10.0])
    expected = np.sqrt(150.0) * 0.17e-3 * np.sqrt(2650 / 1e5)
    assert np.isclose(indicators.inertial_number(rate, 1e5, 0.17e-3, 2650), expected)
    assert indicators.inertial_number(rate, 0.0, 0.17e-3, 2650) == np.inf
    assert indicators.inertial_number(0 * rate, 0.0, 0.17e-3, 2650) == 0.0


def test_overlap_and_rattlers_and_balance_of_a_chain():
    """Three grains in a row: the middle one is balanced, the fourth touches nothing."""
    radius = np.array([1.0, 2.0, 1.0, 1.0])
    contacts = Contacts(
        np.array([[0, 1], [1, 2]]), np.array([[1.0, 0, 0], [1.0, 0, 0]]), np.array([0.1, 0.1]),
        np.array([3.0, 3.0]), np.zeros((2, 3)), np.zeros((2, 3)),
    )  # fmt: skip
    assert np.isclose(indicators.overlap_ratio(radius, contacts), np.mean([0.05, 0.025, 0.025, 0.05]))
    assert indicators.rattler_fraction(4, contacts) == 0.75
    np.testing.assert_allclose(indicators.resultant_forces(4, contacts)[:, 0], [-3.0, 0.0, 3.0, 0.0])
    assert np.isclose(indicators.unbalanced_force(4, contacts), (6.0 / 4) / 3.0)


def test_nothing_touching_is_no_error():
    assert indicators.overlap_ratio(np.ones(3), NONE) == 0.0
    assert indicators.rattler_fraction(3, NONE) == 1.0
    assert indicators.unbalanced_force(3, NONE) == 0.0
    assert indicators.elastic_energy(Scene(), np.ones(3), NONE) == 0.0


def test_kinetic_energy_leaves_the_mean_field_out():
    scene = Scene()
    radius = np.array([80e-6, 90e-6])
    position = np.array([[1e-3, 2e-3, 3e-3], [0.0, 1e-3, 0.0]])
    L = np.diag([5.0, 5.0, -10.0])
    state = grains_in_cell(scene, radius, position, np.eye(3) * 4e-3)
    moving = state.replace(velocity=position @ L.T, velocity_gradient=L)
    assert indicators.kinetic_energy(moving) < 1e-40
    extra = np.array([[0.1, 0, 0], [0, 0, 0.2]])
    spin = np.array([[0, 10.0, 0], [0, 0, 0]])
    moving = moving.replace(velocity=moving.velocity + extra, angular_velocity=spin)
    mass = scene.mass(radius)
    expected = 0.5 * (mass @ [0.01, 0.04] + 0.4 * mass[0] * radius[0] ** 2 * 100)
    assert np.isclose(indicators.kinetic_energy(moving), expected)
    np.testing.assert_allclose(indicators.drift_velocity(moving), mass @ extra / mass.sum())
