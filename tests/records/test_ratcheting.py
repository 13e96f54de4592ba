"""The work of YADE's factor against ratcheting closes the energy balance, even where it is several percent."""

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.errors import LabkitWarning
from labkit.records.ratcheting import Ratcheting, ratcheting_power
from labkit.results.verify import findings

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def squeezed():
    """120 grains at e = 0.3, which overlap by 7 % of their diameter."""
    with pytest.warns(LabkitWarning, match="a mean (overlap|stress) of"):
        return lk.make_specimen(lk.Recipe(void_ratio=0.3, grains=120), lk.Scene(), progress=False)


def test_the_balance_closes_at_large_overlaps(squeezed, tmp_path):
    file = tmp_path / "r.run.nc"
    path = lk.paths.ConstantVolume(strain=0.3, rate=40.0)
    run = lk.run(squeezed, path, file=file, progress=False, snapshots=1, record_strain=6e-4)
    assert run.complete  # the check would stop the run because of the recorded error alone
    with netCDF4.Dataset(file) as data:
        recorded = data["energy_balance_error"][:].filled()
        created = data["checkpoint"]["ratcheting_work"][:].filled()
        work = np.maximum(np.abs(data["cell_work"][:].filled()), data.ledger[0])
    assert recorded.min() < -0.05
    assert np.abs(recorded + created / work).max() < 0.1 * np.abs(recorded).max()
    balance = next(finding for finding in findings(run.data) if finding.name.startswith("energy balance"))
    assert balance.holds and balance.value < 0.01


def test_a_law_without_the_factor_creates_nothing(squeezed):
    state = squeezed.replace(scene=lk.Scene(law="spring_dashpot"))
    assert ratcheting_power(state) == 0.0


def test_the_power_of_two_equal_grains_is_the_overlap_ratio_of_that_of_the_spring():
    """Grains of radius R with an overlap of 0.02 R that slide past each other: P = (delta/2R) t . u."""
    radius, speed, force = 1e-3, 0.3, 0.05
    scene = lk.Scene(mean_diameter=2 * radius, diameter_spread=0.0)
    from labkit.grains.state import grains_in_cell

    state = grains_in_cell(scene, np.full(2, radius), np.array([[0, 0, 0], [1.98 * radius, 0, 0]]), np.eye(3) * 0.02)
    state = state.replace(
        contact_grain=np.array([[0, 1]], np.int32),
        contact_shift=np.zeros((1, 3), np.int32),
        tangential_force=np.array([[0.0, force, 0.0]]),
        rolling_moment=np.zeros((1, 3)),
        velocity=np.array([[0.0, 0.0, 0.0], [0.0, speed, 0.0]]),
        angular_velocity=np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 10.0]]),
    )
    slip = 2.0 / 1.98 * speed - radius * 50.0
    assert np.isclose(ratcheting_power(state), force * slip * 0.02 / 2.0)


def test_a_record_that_is_replaced_is_not_counted_twice(squeezed):
    sums = Ratcheting()
    for number, time in ((0, 0.0), (1, 1.0), (2, 2.0), (2, 2.1)):
        sums.add(number, time, ratcheting_power(squeezed))
    assert len(sums.work) == 3
