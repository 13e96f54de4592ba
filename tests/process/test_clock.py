"""Clocks that go back, and dates that Python cannot represent."""

import os
import subprocess
import sys
import time
from pathlib import Path

import netCDF4
import pytest

import labkit as lk
from labkit.model.run_file import write_result
from labkit.records.recorder import Writer
from tests.conftest import ROOT

pytestmark = pytest.mark.slow

YEAR = 365.2425 * 86400.0
SOURCE = Path(__file__).parent / "clock.c"


@pytest.fixture(scope="module")
def clock(tmp_path_factory):
    library = tmp_path_factory.mktemp("clock") / "clock.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", SOURCE, "-o", library, "-ldl"], check=True)
    return library


def labkit(clock, *words, **settings):
    environment = {**os.environ, "LD_PRELOAD": str(clock), **{name: str(value) for name, value in settings.items()}}
    command = [sys.executable, "-m", "labkit.cli", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("back", [1e3, 1e4, 1e9])
def test_a_run_over_which_the_clock_goes_back_is_readable(back, clock, specimen_file, tmp_path):
    """It goes back after the first save."""
    file = tmp_path / "r.run.nc"
    words = ("run", "cv", specimen_file, "--strain", 0.01, "--save-every", 1, "-o", file)
    done = labkit(clock, *words, CLOCK_BACK=int(back), CLOCK_FILE=file)
    assert done.returncode == 0, done.stderr
    with netCDF4.Dataset(file) as run:
        assert 0.0 <= run.wall_time < 1e4
    assert lk.Run.open(file).complete


@pytest.mark.parametrize("year", [2263, 33658, 292471, 292_000_000_000])
def test_a_year_that_python_does_not_know_is_one_sentence(year, clock, specimen_file, tmp_path):
    words = ("run", "cv", specimen_file, "--strain", 1e-3, "-o", tmp_path / "r.run.nc")
    done = labkit(clock, *words, CLOCK_ADD=int((year - 2025) * YEAR))
    said = "labkit: the clock of this computer is not between the years 1678 and 2262: set it\n"
    assert (done.returncode, done.stderr) == (2, said) and not list(tmp_path.iterdir())


@pytest.mark.parametrize("year", [1700, 1969, 2260])
def test_any_other_year_is_accepted(year, clock, specimen_file, tmp_path):
    words = ("run", "cv", specimen_file, "--strain", 1e-3, "-o", tmp_path / "r.run.nc")
    done = labkit(clock, *words, CLOCK_ADD=int((year - 2026) * YEAR))
    assert done.returncode == 0 and lk.Run.open(tmp_path / "r.run.nc").complete, done.stderr


def test_a_writer_writes_again_after_the_clock_went_back(monkeypatch):
    """Otherwise a run would not be saved for as long as the clock went back."""
    writer, now = Writer(), time.monotonic()
    writer.start(lambda: None)
    writer.wait()
    assert not writer.is_due()
    monkeypatch.setattr(time, "monotonic", lambda: now - 3600.0)
    assert writer.is_due()
    writer.close()


def test_a_prediction_over_which_the_clock_goes_back_has_no_negative_time(tmp_path):
    model = lk.model.Model()
    state = lk.model.isotropic_state(model, 0.67, 4e5)
    result = lk.model.drive(model, lk.paths.ConstantVolume(strain=0.01), state)
    write_result(tmp_path / "m.run.nc", result, wall_time=-5.0)
    with netCDF4.Dataset(tmp_path / "m.run.nc") as run:
        assert run.wall_time == 0.0
