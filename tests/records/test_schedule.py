"""Records and snapshots: evenly spaced, merged at the end and at reversals, identical after an interruption."""

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.files.schema import CONTACTS, RECORD
from labkit.paths.registry import make_path
from labkit.records.schedule import Options, Schedule

pytestmark = pytest.mark.slow

REVERSALS = (0.0063, -0.0041, 0.0058)  # not multiples of the record interval
CYCLIC = {"reversals": REVERSALS, "pressure": 0.5e6, "rate": 20.0}


@pytest.fixture(scope="module")
def state(loose_specimen):
    return loose_specimen


def recorded_steps(schedule):
    """Steps of all records of a path that does not stop early."""
    step, steps = 0, [0]
    while step < schedule.steps:
        step = schedule.next_stop(step)
        if schedule.is_record(step):
            steps.append(step)
    return np.array(steps)


@pytest.mark.parametrize(
    "reversals", [(0.4,), (0.0503,), REVERSALS, (-0.01, 0.02, -0.03, 0.04), (0.001, -0.001, 0.002)]
)
@pytest.mark.parametrize("record_strain", [1e-4, 1e-3, 3.3e-3, 1.0])
def test_records_are_never_closer_than_half_an_interval(reversals, record_strain):
    path = make_path("cyclic_cp", {"reversals": reversals, "pressure": 0.5e6, "rate": 10.0})
    for time_step in (1.19e-7, 1.23e-7, 3.1e-7):
        schedule = Schedule.of(path, time_step, 500, Options(record_strain=record_strain))
        steps, interval = recorded_steps(schedule), schedule.steps_per_record
        assert set(schedule.turns) <= set(steps.tolist())
        gaps = np.diff(steps)
        assert gaps.min() >= interval / 2 and gaps.max() < 2 * interval
        assert schedule.records == len(gaps)
        regular = steps[~np.isin(steps, schedule.turns)]
        assert (regular % interval == 0).all()


@pytest.mark.parametrize("snapshots", [0, 1, 2, 7, 20, 401, 10**6])
def test_snapshots_are_evenly_spaced_from_the_first_record_to_the_last(snapshots):
    schedule = Schedule.of(make_path("cv", {"rate": 10.0}), 1.23e-7, 500, Options(snapshots=snapshots))
    last = schedule.records
    kept = [record for record in range(last + 1) if schedule.is_snapshot(record, record == last)]
    assert len(kept) == (min(snapshots, last) + 1 if snapshots else 0)
    if kept:
        assert (kept[0], kept[-1]) == (0, last)
        assert np.ptp(np.diff(kept)) <= 1


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_the_last_record_of_a_run_is_as_far_from_the_one_before_as_the_others(engine, state):
    """At this rate the last regular record would be one step before the end of the path."""
    path = lk.paths.ConstantVolume(strain=0.02, rate=41.0)
    run = lk.run(state, path, engine=engine, snapshots=4, progress=False)
    strain = run.data["axial_strain"].values
    assert np.isclose(strain[-1], 0.02, atol=5e-6)
    gaps = np.diff(strain)
    assert gaps.min() > 0.5e-3 and gaps.max() < 1.5e-3
    at_snapshots = run.data["axial_strain"].values[run.data["record"].values]
    np.testing.assert_allclose(at_snapshots, np.linspace(0.0, 0.02, 5), atol=1e-3)
    assert np.diff(at_snapshots).min() > 0.7 * 0.005


@pytest.mark.parametrize("engine", ["fused", "yade"])
def test_the_reversals_of_a_cyclic_run_are_recorded_without_close_neighbours(engine, state):
    run = lk.run(state, make_path("cyclic_cp", CYCLIC), engine=engine, snapshots=3, progress=False)
    strain = run.data["axial_strain"].values
    for reversal in REVERSALS:
        assert np.abs(strain - reversal).min() < 1e-5
    assert np.abs(np.diff(strain)).min() > 0.45e-3
    assert run.data.sizes["snapshot"] == 4 and run.data["record"].values[-1] == len(strain) - 1


@pytest.mark.parametrize("grains, snapshots", [(200, 10**6), (15_000, 10**6), (200, 0), (100, 20)])
def test_what_is_kept_in_memory_between_two_saves_is_bounded(grains, snapshots):
    """A record with all contacts at every step produced 40 MB/s with 200 grains in version 0.1.0."""
    options = Options(record_strain=1e-9, snapshots=snapshots)
    schedule = Schedule.of(make_path("cv", {"rate": 10.0, "strain": 0.1}), 1e-7, grains, options)
    share = min(1.0, snapshots / schedule.records)
    assert schedule.steps_per_record == 1
    assert schedule.stops_per_checkpoint * (1000 + share * grains * 360) < 300e6
    assert schedule.stops_per_checkpoint <= 5_000


@pytest.mark.parametrize(
    "name, field, stress, measured",
    [
        ("isoc", "pressure", 1e5, "the mean stress"),
        ("isod", "pressure", 3e6, "the mean stress"),
        ("oedometer_reloading", "stresses", "1 kPa", "sigma_zz"),
        ("isotropic_reloading", "pressures", "1 kPa", "the mean stress"),
    ],
)
def test_a_path_that_stops_at_its_start_is_refused(name, field, stress, measured, state, tmp_path):
    with pytest.raises(
        lk.InputError, match=f"is where path {name} stops, but {measured} of the specimen is"
    ) as refused:
        lk.run(state, make_path(name, {field: stress}), file=tmp_path / "r.run.nc", progress=False)
    assert refused.value.field == field
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("record_strain", [4e-4, 1e-3, 1.6e-3])
@pytest.mark.parametrize("save_every", [1, 100])
def test_a_path_that_stops_early_ends_without_a_close_record(record_strain, save_every, state):
    """It does so whether or not the record before the end is in the file already."""
    path = lk.paths.IsotropicCompression(pressure=1.6e6, rate=20.0)
    run = lk.run(state, path, progress=False, record_strain=record_strain, save_every=save_every, snapshots=1)
    strain, pressure = run.data["axial_strain"].values, run.data.lab.mean_stress().values
    assert (strain[-1] < 0.1) and pressure[-1] >= 1.6e6 > pressure[:-1].max()
    assert np.diff(strain).min() > 0.49 * record_strain
    assert run.data["record"].values[-1] == len(strain) - 1


class Stop(Exception):
    """Raised from a progress function to interrupt a run."""


def contents(file):
    """All recorded variables of a run file, and whether it is complete."""
    with netCDF4.Dataset(file) as run:
        values = {name: run[name][...].filled() for name in RECORD}
        return values | {name: run["contacts"][name][...].filled() for name in CONTACTS}, bool(run.complete)


def assert_identical(first, second):
    (a, a_complete), (b, b_complete) = contents(first), contents(second)
    assert a_complete and b_complete
    for name, values in a.items():
        np.testing.assert_array_equal(values, b[name], err_msg=name)


SAVED = {"save_every": 1, "snapshots": 5}


@pytest.fixture(scope="module")
def whole(state, tmp_path_factory):
    """The file of a cyclic run that was not interrupted."""
    file = tmp_path_factory.mktemp("whole") / "whole.run.nc"
    lk.run(state, make_path("cyclic_cp", CYCLIC), file=file, progress=False, **SAVED)
    return file


@pytest.mark.parametrize("stops", [1, 7, 8, 25])
def test_an_interrupted_cyclic_run_resumes_to_the_same_bits(stops, state, whole, tmp_path):
    """Interrupted at several records, some of them next to a merged one."""
    path, seen = make_path("cyclic_cp", CYCLIC), []

    def progress(fraction, text):
        seen.append(fraction)
        if len(seen) > stops and fraction > 0.0:
            raise Stop

    with pytest.raises(Stop):
        lk.run(state, path, file=tmp_path / "r.run.nc", progress=progress, **SAVED)
    lk.run(state, path, file=tmp_path / "r.run.nc", progress=False, **SAVED)
    assert_identical(whole, tmp_path / "r.run.nc")
