import numpy as np
import pytest

from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import read_state
from labkit.micro.indicators import elastic_energy
from labkit.records.energy import balance_error, drift_velocity, kinetic_energy, open_ledger


def test_kinetic_energy_excludes_the_mean_field():
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


@pytest.mark.parametrize("law", ["rolling_resistance", "spring_dashpot"])
@pytest.mark.parametrize(("friction", "rolling"), [(0.4, 0.1), (0.4, 0.0), (0.0, 0.1), (0.0, 0.0)])
def test_a_ledger_starts_with_the_springs_of_the_scene(law, friction, rolling, specimen_file):
    """The specimen may come from a scene with additional springs."""
    state = read_state(specimen_file)
    assert state.tangential_force.any() and state.rolling_moment.any()
    started = open_ledger(state.replace(scene=Scene(law=law, friction=friction, rolling_friction=rolling)))
    for name, kept in (("tangential_force", friction > 0.0), ("rolling_moment", rolling > 0.0)):
        np.testing.assert_array_equal(getattr(started, name), getattr(state, name) if kept else 0.0)
    assert started.ledger.start == kinetic_energy(started) + elastic_energy(started.snapshot()) > 0.0
    assert balance_error(started) == 0.0
