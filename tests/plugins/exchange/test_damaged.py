"""Damaged and hostile files are reported in one sentence, and nothing is imported."""

import zipfile

import numpy as np
import pytest

import labkit as lk
from labkit.plugins.exchange import read

POSITION = np.array([[1.0, 1.0, 1.0], [2.9, 1.0, 1.0], [1.0, 2.9, 1.0]])
GRAINS = {"position": POSITION, "radius": np.ones(3), "cell": 10.0 * np.eye(3)}
LIST = {"id1": np.array([0, 0]), "id2": np.array([1, 2]), "fn": np.ones(2)}
KNOWN = {"length_unit": "mm", "force_unit": "N", "force_sign": "compression", "first_id": 0}
TABLE = {"box": "10", "size": "radius", **KNOWN}
ROWS = "1 1 1 1\n2.9 1 1 1\n"


NO_NUMBERS = "values that are not numbers"


def changed(name, index, value):
    values = {**GRAINS, **LIST}[name].astype(float)
    values[index] = value
    return {name: values}


@pytest.mark.parametrize(
    "change, message",
    [
        (changed("position", 0, np.nan), f"positions with {NO_NUMBERS}"),
        (changed("position", 0, 1e300), "boxes away"),
        (changed("radius", 1, np.inf), f"sizes with {NO_NUMBERS}"),
        (changed("radius", 1, 1e6), r"a grain of 2e\+03 m in a box 0.01 m wide"),
        (changed("radius", 1, -1.0), "sizes that are not positive"),
        ({"radius": np.ones(2)}, r"sizes of shape \(2,\), not \(3,\)"),
        ({"radius": np.ones(3, complex)}, f"sizes with {NO_NUMBERS}"),
        ({"position": POSITION[:, :2]}, r"positions have the shape \(3, 2\)"),
        ({"cell": np.zeros((3, 3))}, "--box"),
        ({"cell": -np.eye(3)}, "a box without volume, or a left-handed one"),
        ({"cell": np.full((3, 3), np.nan)}, f"a box with {NO_NUMBERS}"),
        ({"cell": np.ones((2, 3))}, "a box of shape"),
        (changed("id2", 1, np.nan), "not whole"),
        (changed("id2", 1, 1.5), "not whole"),
        ({"id2": np.array([1])}, "names 2 first and 1 second grains"),
        (changed("fn", 0, np.inf), f"normal forces with {NO_NUMBERS}"),
        ({"fn": np.ones(3)}, "normal forces of shape"),
    ],
)
def test_arrays_that_cannot_be_grains_are_refused(change, message, tmp_path):
    np.savez(tmp_path / "a.npz", **(GRAINS | LIST | change))
    with pytest.raises(lk.InputError, match=message):
        read(tmp_path / "a.npz", **KNOWN)


@pytest.mark.parametrize("name", ["a.csv", "a.spheres", "a.data", "a.dump", "a.restart", "a.vtkhdf", "a.npy", "a.npz"])
@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 20, b"hello world\n"], ids=["empty", "binary", "prose"])
def test_files_without_grains_are_refused(name, content, tmp_path):
    if name == "a.vtkhdf":
        pytest.importorskip("h5py", reason="h5py is not installed")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(lk.InputError, match=r"--format|damaged"):
        read(tmp_path / name, **TABLE)


@pytest.mark.parametrize(
    "name, text, message",
    [
        ("a.spheres", "##PERIODIC:: 10 10 10\n" + ROWS + "1 1", "lacks a number in line 4"),
        ("a.spheres", "##PERIODIC:: 0 0 0\n" + ROWS, "--box"),
        ("a.csv", ROWS.replace(" ", ",") + "1,1\n", "lacks a number in line 3"),
        ("a.data", "by hand\n3 atoms\n" + "".join(f"0 9 {a}lo {a}hi\n" for a in "xyz") +
         "Atoms # sphere\n\n1 1 2 1 1 1 1\n2 1",
         "row 2 has 2 numbers"),
        ("a.restart", "MercuryDPM 1.0\nParticles 2\nSphericalParticle id 7 posi", "damaged"),
    ],
)  # fmt: skip
def test_files_that_end_too_early_are_refused(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(lk.InputError, match=message):
        read(tmp_path / name, **{**TABLE, "box": None})


def test_half_an_archive_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", **GRAINS)
    content = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(lk.InputError, match="damaged"):
        read(tmp_path / "a.npz", **KNOWN)


def test_contacts_of_a_grain_with_itself_are_left_out(tmp_path):
    np.savez(tmp_path / "a.npz", **GRAINS, id1=[0, 0, 2], id2=[1, 2, 2], fn=np.ones(3))
    found = read(tmp_path / "a.npz", **KNOWN)
    assert found.grain.tolist() == [[0, 1], [0, 2]] and np.isfinite(found.tangential_force).all()
    assert "1 contacts of a grain with itself are left out" in map(str, found.findings)


@pytest.mark.parametrize("name", ["a.state.nc", "a.state.npz"])
def test_a_state_of_labkit_needs_no_import(name, soft_specimen, tmp_path):
    lk.write_state(tmp_path / name, soft_specimen)
    with pytest.raises(lk.InputError, match="is a state file of labkit: commands read it as it is"):
        read(tmp_path / name, **KNOWN)


def test_what_is_no_array_in_an_archive_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", **GRAINS)
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("readme.txt", "by the author")
    with pytest.raises(lk.InputError, match=r"readme.txt is no array"):
        read(tmp_path / "a.npz", **KNOWN)
