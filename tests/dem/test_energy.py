import numpy as np

from labkit.dem.energy import drift_velocity, kinetic_energy
from labkit.dem.scene import Scene
from labkit.dem.state import grains_in_cell


def test_kinetic_energy_leaves_the_mean_field_out():
    scene = Scene()
    radius = np.array([80e-6, 90e-6])
    position = np.array([[1e-3, 2e-3, 3e-3], [0.0, 1e-3, 0.0]])
    L = np.diag([5.0, 5.0, -10.0])
    state = grains_in_cell(scene, radius, position, np.eye(3) * 4e-3)
    moving = state.replace(velocity=position @ L.T, velocity_gradient=L)
    assert kinetic_energy(moving) < 1e-40
    extra = np.array([[0.1, 0, 0], [0, 0, 0.2]])
    spin = np.array([[0, 10.0, 0], [0, 0, 0]])
    moving = moving.replace(velocity=moving.velocity + extra, angular_velocity=spin)
    mass = scene.mass(radius)
    expected = 0.5 * (mass @ [0.01, 0.04] + 0.4 * mass[0] * radius[0] ** 2 * 100)
    assert np.isclose(kinetic_energy(moving), expected)
    np.testing.assert_allclose(drift_velocity(moving), mass @ extra / mass.sum())
