"""Files without the netCDF library: archives of arrays, with the content, the hashes and the doors of netCDF files."""

import json
import zipfile

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.files import arrays
from labkit.files.writable import stem
from labkit.simulation.tasks import RunTask, execute


@pytest.fixture(scope="module")
def run(soft_specimen, tmp_path_factory):
    """A run in memory, and the same run as an archive and as a netCDF file."""
    folder = tmp_path_factory.mktemp("arrays")
    task = RunTask(state=soft_specimen, path=lk.paths.ConstantVolume(strain=0.002), options=lk.Options(snapshots=3))
    execute(task)
    for name in ("r.run.npz", "r.run.nc"):
        task.memory.write(folder / name)
    return task.memory, folder / "r.run.npz", folder / "r.run.nc"


def test_a_run_is_the_same_in_both(run):
    _, archive, netcdf = run
    here, there = lk.open_run(archive), lk.open_run(netcdf)
    assert here.identical(there) and len(here.attrs["data_sha256"]) == 64
    assert lk.Run.open(archive).state.digest() == lk.Run.open(netcdf).state.digest() == run[0].state.digest()
    assert main(["info", str(archive)]) == 0


def test_numpy_reads_the_arrays(run):
    with np.load(run[1]) as loaded:
        np.testing.assert_array_equal(loaded["stress"], lk.open_run(run[2])["stress"])
        assert loaded["contacts/normal"].shape[1] == 3


def test_a_state_is_the_same_in_both(soft_specimen, tmp_path):
    for name in ("s.state.npz", "s.state.nc"):
        lk.write_state(tmp_path / name, soft_specimen)
        assert lk.read_state(tmp_path / name).digest() == soft_specimen.digest()
    read = arrays.Dataset(tmp_path / "s.state.npz")
    assert read.ncattrs() and read.variables["position"].dimensions == ("grain", "i")
    with pytest.raises(lk.InputError, match="labkit export FILE"):
        arrays.Dataset(tmp_path / "s.state.nc")


@pytest.mark.parametrize("kind", ["s.state.nc", "r.run.nc"])
def test_the_command_that_the_refusal_names_writes_the_archive(kind, run, tmp_path):
    source = tmp_path / kind
    state = run[0].state
    lk.write_state(source, state) if kind == "s.state.nc" else run[0].write(source)
    assert main(["export", str(source), "-o", str(tmp_path / "new.state.npz")]) == 0
    read = lk.read_state(tmp_path / "new.state.npz")
    assert read.digest() == lk.read_state(source, snapshot=-1 if kind == "r.run.nc" else None).digest()
    assert {file.name for file in tmp_path.iterdir()} == {kind, "new.state.npz"}


def test_damage_is_found(soft_specimen, tmp_path):
    lk.write_state(tmp_path / "s.state.npz", soft_specimen)
    whole = (tmp_path / "s.state.npz").read_bytes()
    for number in (3, 100, len(whole) // 2, len(whole) - 3):
        (tmp_path / "d.npz").write_bytes(whole[:number] + bytes([whole[number] ^ 1]) + whole[number + 1 :])
        with pytest.raises(lk.InputError):
            lk.read_state(tmp_path / "d.npz")
    for content in (b"PK", whole[:500]):
        (tmp_path / "d.npz").write_bytes(content)
        with pytest.raises(lk.InputError):
            lk.read_state(tmp_path / "d.npz")


def test_a_run_is_not_saved_in_an_archive(run, tmp_path, capsys):
    state = tmp_path / "s.state.npz"
    lk.write_state(state, run[0].state)
    assert main(["run", "cv", str(state), "-o", str(tmp_path / "r.run.npz")]) == 2
    assert "r.run.nc" in capsys.readouterr().err and [*tmp_path.iterdir()] == [state]
    assert stem(run[1]) == stem(run[2]) == "r" and stem(state) == "s"


def test_an_unfinished_run_is_not_extended(run):
    with pytest.raises(lk.InputError, match="new run"):
        arrays.Dataset(run[1], "a")


HOSTILE = {
    "length beyond an index": ("dimensions", "grain", 10**30),
    "infinite length": ("dimensions", "grain", float("inf")),
    "attribute of 50 GB": ("attributes", "time", ["S1000000000", ["a"] * 50]),
    "attribute of objects": ("attributes", "time", ["|O", [1]]),
    "attribute of dates": ("attributes", "time", ["<M8[s]", 1]),
    "array of complex numbers": ("radius.npy", complex, None),
    "array in half precision": ("radius.npy", "f2", None),
    "array of 10^30 numbers": ("radius.npy", float, (10**30,)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_archive_is_refused(name, soft_specimen, tmp_path):
    lk.write_state(tmp_path / "s.state.npz", soft_specimen)
    with zipfile.ZipFile(tmp_path / "s.state.npz") as archive:
        content = {member: archive.read(member) for member in archive.namelist()}
    header, (where, what, value) = json.loads(content["header.json"]), HOSTILE[name]
    del header["attributes"]["data_sha256"]  # of its author, who has no hash to match
    if where in header:
        header[where][what] = value
    else:
        shape = value or soft_specimen.radius.shape
        content[where] = (
            b"\x93NUMPY\x01\x00\xff\x00"
            + repr({"descr": np.dtype(what).str, "fortran_order": False, "shape": shape}).ljust(254).encode()
            + b"\n"
            + soft_specimen.radius.astype(what).tobytes()
        )
    content["header.json"] = json.dumps(header).encode()
    with zipfile.ZipFile(tmp_path / "h.state.npz", "w") as archive:
        for member, data in content.items():
            archive.writestr(member, data)
    with pytest.raises(lk.InputError, match="is not a netCDF file, or is damaged"):
        lk.read_state(tmp_path / "h.state.npz")
