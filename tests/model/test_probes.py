"""Probes of the constitutive model against its rates, and the state that it takes from grains."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.micro.fabric import statistics
from labkit.micro.tensors import to_six, to_tensor
from labkit.model import state_of
from labkit.model.stiffness import stress_rate
from labkit.plugins.probes import probe_model
from tests.model.random_states import random_state

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def sheared_state(run_file):
    return lk.read_state(run_file)


@pytest.fixture(scope="module")
def state():
    return random_state(np.random.default_rng(4))


def test_a_small_strain_probe_is_the_rate_of_the_stress(model, state):
    probes = probe_model(state, model, lk.Probing("deviatoric", directions=8, amplitude=1e-7))
    directions = to_tensor(probes.plane.directions(8)[1])
    expected = to_six(stress_rate(model, state, directions))
    found = to_six(probes.data["stress_increment"].values) / 1e-7
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(to_tensor(probes.strain), 1e-7 * directions, atol=1e-21)


def test_stress_probes_reach_their_stress_and_work_as_strain_probes_do(model, state):
    probes = probe_model(state, model, lk.Probing(directions=6, kind="stress", amplitude=1e-6))
    pressure = lk.mean_stress(state.stress(model))
    reached = to_six(probes.data["stress_increment"].values) / (1e-6 * pressure)
    np.testing.assert_allclose(reached, probes.plane.directions(6)[1], atol=1e-6)
    rate = to_six(stress_rate(model, state, probes.data["strain_increment"].values))
    np.testing.assert_allclose(rate / (1e-6 * pressure), reached, atol=1e-4)


def test_the_model_takes_its_state_from_the_grains(model, sheared_state):
    snapshot = sheared_state.snapshot()
    state, known = state_of(snapshot), statistics(snapshot)
    assert (state.Z, state.Lam) == (known.coordination_number, known.mean_normalised_force)
    np.testing.assert_allclose(state.A, known.contact_anisotropy, atol=1e-12)
    love = lk.love_stress(snapshot)
    assert np.linalg.norm(state.stress(model) - love) < 0.05 * np.linalg.norm(love)
    by_volume = state_of(snapshot, lk.micro.statistics_by_volume(snapshot))
    assert by_volume.Lam != state.Lam
    assert lk.mean_stress(by_volume.stress(model)) == pytest.approx(lk.mean_stress(love), rel=1e-6)  # n.Lambda_t = 0


def test_grains_without_contacts_have_no_state(sheared_state):
    none = sheared_state.replace(contact_grain=np.zeros((0, 2), int), contact_shift=np.zeros((0, 3), int))
    none = none.replace(tangential_force=np.zeros((0, 3)), rolling_moment=np.zeros((0, 3)))
    with pytest.raises(InputError, match="no contacts"):
        state_of(none.snapshot())
