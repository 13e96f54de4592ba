"""A run that a signal stops: what its file then holds, what the error says, and how the run is resumed."""

import os
import re
import signal

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.io import interruption
from labkit.runs.run import stopping
from labkit.runs.run.loading import Loading
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
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
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


def test_a_second_signal_stops_at_once_and_the_error_counts_what_is_lost(loose_specimen, monkeypatch, tmp_path):
    plan, waiting = Loading._plan, [signal.SIGINT, signal.SIGTERM]

    def send_between_records(loading, *arguments):
        planned = plan(loading, *arguments)
        while waiting and loading.clock.accumulated_strain > 0.0041:
            os.kill(os.getpid(), waiting.pop())
        return planned

    monkeypatch.setattr(Loading, "_plan", send_between_records)
    monkeypatch.setattr(interruption, "ECHO", -1.0)
    file = tmp_path / "r.run.nc"
    said = stop(loose_specimen, file, False, save_every=1000, record_strain=0.004)
    assert re.search(r"is saved: 1 record, up to axial strain -?0\.00%; .* computes 1 later record again", said)
    assert len(times(file)) == 1


def test_two_signals_of_one_request_count_as_one(loose_specimen, tmp_path):
    """GNU timeout, and a terminal whose foreground program passes signals on, send the same signal twice."""
    file = tmp_path / "r.run.nc"
    assert "is saved: 5 records" in stop(loose_specimen, file, send(signal.SIGTERM, signal.SIGTERM), save_every=4), (
        "the run stopped before its checkpoint"
    )
