"""A small grain that vibrates between two large ones: case 3 of analysis/plans/sticking.md.

A code that takes the velocity of a contact at mid-step and its normal at the end of the step counts a part of the
normal velocity as slip; small grains between large ones can then stick (Vyas et al. 2025, 10.1016/j.cpc.2025.109524).
"""

import numpy as np
import pytest
from scipy import stats

import labkit as lk
from labkit.engines import Device
from labkit.grains.laws import LAWS, Coulomb, FirstOrder, LinearSpring, LocalDamping, Midpoint
from labkit.grains.laws.contact import ContactMotion
from labkit.grains.laws.kinematics import along_branch
from labkit.grains.laws.vectors import across, cross
from labkit.grains.state import grains_in_cell
from labkit.records.energy import stored_energy

pytestmark = pytest.mark.slow

SMALL, LARGE = 1e-5, 1e-4  # radii of the grains (m)
OVERLAP = 0.02 * SMALL  # m
TRIALS, SEED, STEPS = 10, 59, 20_000  # default time steps
MOST_CHANGE = 0.01  # of the energy


class Late(FirstOrder):
    """Wrong kinematics: the normal of the slip is that of 100 time steps after the end of the step."""

    @staticmethod
    def move(contact, dt):
        n, a, b = contact.normal, contact.spin_a, contact.spin_b
        before, after = along_branch(contact, dt), along_branch(contact, -100.0 * dt)
        half = 0.5 * contact.overlap
        surface = cross((contact.radius_a - half) * a + (contact.radius_b - half) * b, n)
        return ContactMotion(before, 0.0, across(contact.velocity - surface, after))


@pytest.fixture(scope="module", autouse=True)
def laws():
    """Registers springs with friction under three kinematics, by name."""
    for kinematics in (Midpoint, FirstOrder, Late):
        fields = {"name": kinematics.__name__, "parts": LinearSpring() + Coulomb() + LocalDamping()}
        lk.register_law(type("Springs", (lk.ContactLaw,), {**fields, "kinematics": kinematics}))
    yield
    for kinematics in (Midpoint, FirstOrder, Late):
        LAWS._entries.pop(kinematics.__name__)


def chain(scene, angle):
    """A closed chain along x of two large grains, and a small one in their wedge at an angle (rad) from x."""
    reach = LARGE + SMALL - OVERLAP
    half, out = reach * np.cos(angle), reach * np.sin(angle)
    width = 2.0 * half + 2.0 * LARGE - OVERLAP
    middle = np.array([0.5 * width, 4.0 * LARGE, 4.0 * LARGE])
    position = middle + np.array([[-half, 0.0, 0.0], [half, 0.0, 0.0], [0.0, out, 0.0]])
    cell = np.diag([width, 8.0 * LARGE, 8.0 * LARGE])
    return grains_in_cell(scene, np.array([LARGE, LARGE, SMALL]), position, cell)


def energy_changes(law, factor):
    """Return the change of energy plus friction loss of each chain over the energy at the start; 0 without errors."""
    scene = lk.Scene(law=law, friction=10.0, rolling_friction=0.0, local_damping=0.0)
    scene = scene.replace(mean_diameter=2.0 * SMALL, diameter_spread=0.0)
    scene = scene.replace(time_step_factor=factor * scene.time_step_factor)
    changes = []
    for angle in np.deg2rad(np.random.default_rng(SEED).uniform(8.0, 24.0, TRIALS)):
        engine = Device()(chain(scene, angle))
        start = stored_energy(engine.state())
        engine.advance(round(STEPS / factor), np.zeros((3, 3)))
        end = engine.state()
        changes.append((stored_energy(end) + end.ledger.total_loss) / start - 1.0)
    return np.array(changes)


def is_noticed(changes):
    """True if the mean size of the changes exceeds the limit with its 95 % interval."""
    size = np.abs(changes)
    interval = stats.t.ppf(0.975, len(size) - 1) * size.std(ddof=1) / np.sqrt(len(size))
    return bool(size.mean() - interval > MOST_CHANGE)


@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize("law", ["rolling_resistance", "Midpoint", "FirstOrder"])
def test_energy_is_kept_between_a_small_grain_and_large_ones(law, factor):
    assert not is_noticed(energy_changes(law, factor))


def test_the_criterion_notices_a_normal_of_a_later_time():
    """The error is of first order in the time step: halving it halves the energy that is created."""
    whole, half = (energy_changes("Late", factor) for factor in (1.0, 0.5))
    assert is_noticed(whole) and is_noticed(half)
    assert whole.mean() > 1.5 * half.mean() > 0.0
