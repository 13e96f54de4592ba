"""Kills, signals, a second writer and a full disk during real runs on YADE."""

import shutil
import subprocess

import netCDF4
import numpy as np
import pytest

import labkit as lk
from labkit.files.schema import CONTACTS, RECORD
from labkit.process.interruption import only_writer
from tests.killed import run_killed

pytestmark = [pytest.mark.slow, pytest.mark.yade]

OPTIONS = {"engine": "yade", "save_every": 2, "progress": False}
PATHS = {
    "cv": lk.paths.ConstantVolume(strain=0.01),
    "cp": lk.paths.ConstantMeanStress(pressure=0.5e6, strain=0.008),
    "isoc": lk.paths.IsotropicCompression(strain=0.004),
    "cyclic_cp": lk.paths.CyclicConstantMeanStress(pressure=0.5e6, reversals=(0.004, -0.002, 0.002)),
}
CP = ("--engine", "yade", "--save-every", 2, "--pressure", 0.5e6, "--strain", 0.008)


def contents(file):
    with netCDF4.Dataset(file) as dataset:
        data = {name: dataset[name][...].filled() for name in RECORD}
        data |= {f"contacts/{name}": dataset["contacts"][name][...].filled() for name in CONTACTS}
        return data, int(dataset.complete)


def assert_same_bits(file, reference):
    records, complete = contents(file)
    assert complete == 1
    for variable, values in contents(reference)[0].items():
        np.testing.assert_array_equal(records[variable], values, err_msg=variable)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, loose_specimen):
    file = tmp_path_factory.mktemp("tiny") / "tiny.state.nc"
    lk.write_state(file, loose_specimen)
    return file


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, tiny):
    """Function that runs a path once without interruption and returns its file."""
    folder = tmp_path_factory.mktemp("undisturbed")

    def make(name):
        file = folder / f"{name}.run.nc"
        lk.run(lk.read_state(tiny), PATHS[name], file=file, **OPTIONS)  # kill it once: later it is complete
        return file

    return make


@pytest.mark.parametrize(
    "name, moment, count, kept",
    [
        ("cv", "half a save", 3, 3),
        ("isoc", "save", 1, 1),
        ("cyclic_cp", "save", 4, 7),
        ("cyclic_cp", "half a save", 6, 9),
    ],
)
def test_a_killed_run_ends_with_bit_identical_records(name, moment, count, kept, tiny, undisturbed, tmp_path):
    file, state = tmp_path / "r.run.nc", lk.read_state(tiny)
    run_killed(count, state, PATHS[name], file, OPTIONS, moment)
    records, complete = contents(file)
    assert (len(records["time"]), complete) == (kept, 0)
    lk.run(state, PATHS[name], file=file, **OPTIONS)
    assert_same_bits(file, undisturbed(name))
    assert [each.name for each in tmp_path.iterdir()] == ["r.run.nc"]


def test_a_second_process_on_the_same_file_is_refused(tiny, labkit_command, tmp_path):
    file = tmp_path / "r.run.nc"
    with only_writer(file):
        done = labkit_command("run", "cp", tiny, *CP, "-o", file)
    assert done.returncode == 2 and not file.exists()
    assert done.stderr.startswith(f"labkit: {file} ") and done.stderr.count("\n") == 1


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
    file, state = small_disk / "r.run.nc", lk.read_state(tiny)
    with pytest.raises(lk.PhysicsError, match="could not be saved"):
        lk.run(state, PATHS["cv"], file=file, **OPTIONS)
    records, complete = contents(file)
    assert complete == 0 and len(records["time"]) >= 1
    assert [p.name for p in small_disk.iterdir()] == ["r.run.nc"]
    # on a disk with enough space, the run resumes
    moved = small_disk.parent / "r.run.nc"
    shutil.copy(file, moved)
    lk.run(state, PATHS["cv"], file=moved, **OPTIONS)
    assert_same_bits(moved, undisturbed("cv"))
