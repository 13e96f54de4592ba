"""Kills, signals, a second writer and a full disk during real runs. LABKIT_KILLS: kills per path (default 1)."""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time

import netCDF4
import numpy as np
import pytest

from labkit.io.schema import CONTACTS, RECORD

pytestmark = pytest.mark.slow

ESTIMATE = re.compile(r"grains, .* steps, about ")  # the line with the expected time of a run
KILLS = int(os.environ.get("LABKIT_KILLS", "1"))
PATHS = {
    "cv": ["--strain", "0.01"],
    "cp": ["--pressure", "0.5e6", "--strain", "0.008"],
    "isoc": ["--strain", "0.004"],
    "cyclic_cp": ["--pressure", "0.5e6", "--reversals", "0.004,-0.002,0.002"],
}


def start(name, specimen, file):
    command = [sys.executable, "-m", "labkit.cli", "run", name, str(specimen), *PATHS[name], "--save-every", "2"]
    command += ["--engine", "yade"]  # slow enough to be interrupted
    return subprocess.Popen([*command, "-o", str(file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process):
    out, err = process.communicate(timeout=300)
    lines = err.splitlines(keepends=True)
    return process.returncode, out, "".join(line for line in lines if not ESTIMATE.search(line))


def contents(file):
    with netCDF4.Dataset(file) as dataset:
        data = {name: dataset[name][...].filled() for name in RECORD}
        data |= {f"contacts/{name}": dataset["contacts"][name][...].filled() for name in CONTACTS}
        return data, int(dataset.complete)


def wait_for(file, process, seconds=60):
    end = time.monotonic() + seconds
    while not file.exists():
        assert process.poll() is None and time.monotonic() < end, "the run did not start"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, labkit_command):
    file = tmp_path_factory.mktemp("tiny") / "tiny.state.nc"
    done = labkit_command("specimen", "--void-ratio", 0.67, "--grains", 200, "-o", file)
    assert done.returncode == 0, done.stderr
    return file


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, tiny):
    """Function path -> (file, seconds) that runs each path once without interruption."""
    runs = {}

    def make(name):
        if name not in runs:
            file = tmp_path_factory.mktemp(name) / "r.run.nc"
            begin = time.monotonic()
            code, _, err = finish(start(name, tiny, file))
            assert code == 0, err
            runs[name] = file, time.monotonic() - begin
        return runs[name]

    return make


@pytest.mark.parametrize("name", ["cv", "isoc", "cyclic_cp"])  # one of each kind
def test_a_killed_run_ends_with_bit_identical_records(name, tiny, undisturbed, tmp_path):
    reference, seconds = undisturbed(name)
    file = tmp_path / "r.run.nc"
    chance = random.Random(name)
    kills = 0
    for _ in range(50 * KILLS):
        if kills == KILLS:
            break
        process = start(name, tiny, file)
        try:
            process.wait(chance.uniform(0.5, 1.0) * seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            kills += 1
            process.communicate()
            if file.exists():
                contents(file)  # complete and readable at any moment
        else:
            if kills == KILLS:
                break
            file.unlink()  # the run ended before the kill: repeat it
    assert kills == KILLS
    code, _, err = finish(start(name, tiny, file))
    assert code == 0, err
    expected, _ = contents(reference)
    records, complete = contents(file)
    assert complete == 1
    for variable, values in expected.items():
        np.testing.assert_array_equal(records[variable], values, err_msg=variable)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.run.nc"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_saves_the_last_checkpoint_and_the_resumed_run_has_the_same_bits(number, tiny, undisturbed, tmp_path):
    reference, _ = undisturbed("cp")
    file = tmp_path / "r.run.nc"
    process = start("cp", tiny, file)
    wait_for(file, process)
    time.sleep(0.3)
    process.send_signal(number)
    code, _, err = finish(process)
    assert code == 128 + number and "give the same command to resume it" in err and err.count("\n") == 1
    with netCDF4.Dataset(file) as dataset:
        assert dataset.complete == 0
        assert int(dataset.step) >= 0
    code, _, err = finish(start("cp", tiny, file))
    assert code == 0, err
    expected, _ = contents(reference)
    records, complete = contents(file)
    assert complete == 1
    for variable, values in expected.items():
        np.testing.assert_array_equal(records[variable], values, err_msg=variable)


def test_a_second_process_on_the_same_file_is_refused(tiny, tmp_path):
    file = tmp_path / "r.run.nc"
    first = start("cv", tiny, file)
    wait_for(file, first)
    code, _, err = finish(start("cv", tiny, file))
    assert code == 2 and "being written by another process" in err and err.count("\n") == 1
    code, _, err = finish(first)
    assert code == 0, err


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1.2 MB; the test is skipped where none can be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1200k", "labkit", folder], capture_output=True).returncode:
        pytest.skip("needs permission to mount a small file system")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_is_reported_and_earlier_data_are_kept(small_disk, tiny, undisturbed):
    file = small_disk / "r.run.nc"
    process = start("cv", tiny, file)
    code, _, err = finish(process)
    assert code == 1 and "could not be saved" in err and err.count("\n") == 1, err
    records, complete = contents(file)
    assert complete == 0 and len(records["time"]) >= 1
    assert [p.name for p in small_disk.iterdir()] == ["r.run.nc"]
    # on a disk with enough space, the run resumes
    moved = small_disk.parent / "r.run.nc"
    shutil.copy(file, moved)
    code, _, err = finish(start("cv", tiny, moved))
    assert code == 0, err
    expected, _ = contents(undisturbed("cv")[0])
    np.testing.assert_array_equal(contents(moved)[0]["stress"], expected["stress"])
