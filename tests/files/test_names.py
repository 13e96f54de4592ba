"""The netCDF library changes some names of files; labkit opens exactly the named file, or refuses the name."""

import shutil

import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.files.hashes import once_per_version
from labkit.files.netcdf import open_netcdf

FEW = {"progress": False, "record_strain": 5e-4, "snapshots": 1}


@pytest.fixture
def states(loose_specimen, tmp_path, monkeypatch):
    """The files 111.state.nc and 222.state.nc, named after their seeds, in the current folder."""
    monkeypatch.chdir(tmp_path)
    for seed in (111, 222):
        lk.write_state(f"{seed}.state.nc", loose_specimen.replace(seed=seed))
    return tmp_path


def test_a_backslash_is_refused_when_a_file_is_read(states):
    (states / "a").mkdir()
    shutil.copy("111.state.nc", "a/b.state.nc")
    shutil.copy("222.state.nc", "a\\b.state.nc")
    assert lk.read_state("a/b.state.nc").seed == 111
    with pytest.raises(InputError, match="backslash"):
        lk.read_state("a\\b.state.nc")


@pytest.mark.parametrize("name", ["x\\y.state.nc", "x\\y/s.state.nc"])
def test_a_backslash_is_refused_when_a_state_is_written(name, states, loose_specimen):
    (states / name).parent.mkdir(exist_ok=True)
    before = sorted(states.rglob("*"))
    with pytest.raises(InputError, match="backslash"):
        lk.write_state(name, loose_specimen)
    assert sorted(states.rglob("*")) == before


def test_a_backslash_is_refused_before_a_run_begins(states, loose_specimen):
    path = lk.paths.ConstantVolume(strain=5e-4)
    with pytest.raises(InputError, match="backslash"):
        lk.run(loose_specimen, path, file="x\\y.run.nc", **FEW)
    (states / "x\\y").mkdir()
    with pytest.raises(InputError, match="backslash"):
        lk.run_many([(loose_specimen, path)], "x\\y", **FEW)
    assert not list(states.rglob("*.run.nc"))


@pytest.mark.parametrize("name", [" 1.state.nc", "c:/1.state.nc", "1#mode=bytes.state.nc", "[1].state.nc"])
def test_the_named_file_is_read(name, states):
    (states / name).parent.mkdir(exist_ok=True)
    shutil.copy("111.state.nc", name.strip())
    shutil.copy("222.state.nc", name)
    assert lk.read_state(name).seed == 222
    with open_netcdf(name, "state") as dataset:
        assert dataset.seed == 222


def test_a_file_that_is_replaced_with_its_time_kept_is_read_again(tmp_path):
    file, other = tmp_path / "a.txt", tmp_path / "b.txt"
    file.write_text("one")
    other.write_text("two")
    shutil.copystat(file, other)
    read = once_per_version(lambda name: open(name).read())
    assert read(file) == "one"
    with open(file, "r+") as same:  # the same inode and size
        same.write("two")
    shutil.copystat(other, file)
    assert read(file) == "two"
