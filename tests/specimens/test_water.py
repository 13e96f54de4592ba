"""The redundancy index and Skempton's B."""

import numpy as np
import pytest

import labkit as lk
from labkit.engines.device import Device
from labkit.errors import InputError
from labkit.micro import redundancy_index
from labkit.servo.correction import cell_stiffness
from labkit.specimens import skempton_b

OF_CONTACTS = ("contact_grain", "contact_shift", "tangential_force", "rolling_moment")
SIDE = 5  # grains along an edge of a cubic lattice
RADIUS = 0.1e-3


def lattice(**scene):
    """Equal grains on a cubic lattice, each of which overlaps its six neighbours."""
    spacing = 1.999 * RADIUS
    place = spacing * np.stack(np.meshgrid(*[np.arange(SIDE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cell = np.eye(3) * spacing * SIDE
    state = lk.State.from_arrays(np.full(len(place), RADIUS), place, cell=cell, scene=lk.Scene(**scene))
    return Device("fused")(state).state()  # the engine finds the contacts


@pytest.mark.parametrize(
    "friction, rolling, twisting, index",
    [(0.0, 0.0, 0.0, 3 / 3), (0.4, 0.0, 0.0, 9 / 6), (0.4, 0.1, 0.0, 15 / 6), (0.4, 0.1, 0.1, 18 / 6)],
)
def test_the_index_counts_what_each_contact_resists(friction, rolling, twisting, index):
    state = lattice(friction=friction, rolling_friction=rolling, twisting_friction=twisting)
    assert redundancy_index(state.snapshot()) == pytest.approx(index)


def test_sliding_and_rolling_contacts_and_rattlers_count_less():
    state = lattice(friction=0.4, rolling_friction=0.1)
    normal = state.snapshot().contacts.normal_force
    sliding = np.zeros((len(normal), 3))
    across = np.cross(state.snapshot().contacts.normal, [1.0, 2.0, 3.0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    sliding[::3] = (0.4 * normal[:, None] * across)[::3]
    rolling = np.zeros_like(sliding)
    rolling[1::3] = (0.1 * 0.5 * RADIUS * normal[:, None] * across)[1::3]
    snapshot = state.replace(tangential_force=sliding, rolling_moment=rolling).snapshot()
    assert redundancy_index(snapshot) == pytest.approx((5 - 2 / 3 - 2 / 3) * 3 / 6)
    only = np.any(state.contact_grain == 0, axis=1).nonzero()[0][1:]  # grain 0 keeps one contact
    rattling = state.replace(**{name: np.delete(getattr(state, name), only, axis=0) for name in OF_CONTACTS})
    carried = SIDE**3 * 3 - 6
    assert redundancy_index(rattling.snapshot()) == pytest.approx(5 * carried / (6 * (SIDE**3 - 1)))


def test_cohesion_is_refused_and_no_contact_is_undefined():
    with pytest.raises(InputError, match="needs a law without cohesion or bonds; dmt has them"):
        redundancy_index(lattice(law="dmt").snapshot())
    apart = lattice()
    apart = apart.replace(position=apart.position * 1.1, cell=apart.cell * 1.1)
    none = apart.replace(**{name: getattr(apart, name)[:0] for name in OF_CONTACTS})
    assert np.isnan(redundancy_index(none.snapshot()))


@pytest.fixture(scope="module")
def liquefied():
    """A loose specimen, extended before, in undrained compression until it has no effective stress left."""
    recipe = lk.Recipe(
        preparation="compression", pressure="200 kPa", grains=300, step1_friction=0.4, fabric="pre-extended"
    )
    state = lk.make_specimen(recipe, lk.Scene(time_step_factor=0.3), progress=False)
    path = lk.paths.ConstantVolume(strain=0.06, rate=20)
    return lk.run(state, path, progress=False, snapshots=100, stop_when="r_u > 0.999")


def test_the_index_falls_to_1_at_the_peak_and_below_at_liquefaction(liquefied):
    ratio, q = liquefied.data.lab.quantity("r_u").values, liquefied.data.lab.q().values
    index = np.array([redundancy_index(snapshot) for snapshot in liquefied.snapshots])
    assert len(index) == len(q)
    assert index[0] > 1.2
    assert index[np.argmax(q)] == pytest.approx(1.0, abs=0.15)
    assert ratio[-1] > 0.95 and index[-1] < 0.9  # 0.1 to 0.8, as r_u at the last snapshot is 1.00 to 0.97


def test_constant_volume_is_the_limit_of_stiff_water(liquefied):
    snapshot = liquefied.snapshots[0]
    water, airy = skempton_b(snapshot), skempton_b(snapshot, 2.2e7)
    assert 0.9 < water < 1.0 and airy < water
    assert skempton_b(snapshot, 1e30) == 1.0
    lower = water * 1e5  # du for 100 kPa of total stress
    e, stiffness = lk.micro.void_ratio(snapshot), cell_stiffness(snapshot)
    volume = (1e5 - lower) / (stiffness.sum() / 9.0)  # of the skeleton
    assert volume == pytest.approx(lower * e / (1.0 + e) / 2.2e9)  # of the water in its pores
