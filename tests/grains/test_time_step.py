import numpy as np
import pytest

from labkit.errors import PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.grains.state_file import read_state
from labkit.grains.time_step import critical_time_step, require_stable


def pair(scene):
    """Two equal grains in contact along x."""
    radius = np.full(2, 85e-6)
    position = np.array([[0.0, 0.0, 0.0], [169e-6, 0.0, 0.0]])
    return grains_in_cell(scene, radius, position, np.eye(3) * 1e-3).replace(
        contact_grain=np.array([[0, 1]]),
        contact_shift=np.zeros((1, 3), int),
        tangential_force=np.zeros((1, 3)),
        rolling_moment=np.zeros((1, 3)),
    )


def test_the_limit_of_a_pair_matches_its_closed_form():
    """Sliding couples translation and spin: omega^2 = kt (1/m + R^2/I) = 3.5 kt/m with one grain fixed.

    It is twice that for two free grains; with kappa = 2 this mode is stiffer than the normal spring.
    """
    scene = Scene(rolling_friction=0.0)
    m, kn = scene.mass(85e-6), scene.normal_stiffness(85e-6, 85e-6)
    assert np.isclose(critical_time_step(pair(scene)), 2 / np.sqrt(2 * 3.5 * (kn / 2) / m), rtol=1e-9)


def test_rolling_stiffness_lowers_the_limit_and_no_contacts_mean_no_limit():
    assert critical_time_step(pair(Scene())) < critical_time_step(pair(Scene(rolling_friction=0.0)))
    alone = grains_in_cell(Scene(), np.full(2, 85e-6), np.zeros((2, 3)), np.eye(3) * 1e-3)
    assert critical_time_step(alone) == np.inf


def test_a_time_step_above_the_limit_is_refused(specimen_file):
    state = read_state(specimen_file)
    limit = critical_time_step(state)
    assert 0.4 < state.time_step / limit < 0.8
    require_stable(state.replace(time_step=0.99 * limit))
    with pytest.raises(PhysicsError, match="exceeds the stability limit"):
        require_stable(state.replace(time_step=1.01 * limit))
