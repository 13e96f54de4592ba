"""Extended XYZ: read back by its documented rules and by labkit, one frame or a trajectory; what exports say of it."""

import re

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main
from labkit.plugins.exchange import read


@pytest.fixture(scope="module")
def run_file(soft_specimen, tmp_path_factory):
    """A run to a sheared cell, whose vectors are not perpendicular, with three snapshots."""
    path, file = (
        lk.paths.SimpleShear(strain=0.1, rate=100, pressure="100 kPa"),
        tmp_path_factory.mktemp("x") / "r.run.nc",
    )
    lk.run(soft_specimen, path, file=file, progress=False, record_strain=0.05, snapshots=3).data.close()
    return file


@pytest.fixture(scope="module")
def sheared(run_file):
    return lk.read_state(run_file)


def test_grains_radii_and_cell_are_read_back(sheared, tmp_path):
    lk.write_state(tmp_path / "s.state.nc", sheared)
    assert main(["export", str(tmp_path / "s.state.nc"), "-o", str(tmp_path / "s.xyz")]) == 0
    count, head, *rows = (tmp_path / "s.xyz").read_text().splitlines()
    keys = {key: quoted or plain for key, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', head)}
    assert int(count) == len(rows) == sheared.number_of_grains and keys["pbc"] == "T T T"
    a, b, c = np.array(keys["Lattice"].split(), float).reshape(3, 3)  # vectors in rows
    np.testing.assert_array_equal(np.column_stack([a, b, c]), sheared.cell)
    assert abs(sheared.cell[0, 2]) > 0.01 * sheared.cell[0, 0] or abs(sheared.cell[2, 0]) > 0.01 * sheared.cell[0, 0]
    names, values = keys["Properties"].split(":")[::3], [row.split() for row in rows]
    columns = dict(zip(names, np.cumsum([0, *map(int, keys["Properties"].split(":")[2::3])])[:-1], strict=True))
    first = columns["pos"]
    position = np.array([row[first : first + 3] for row in values], float)
    np.testing.assert_array_equal(position, sheared.position)
    np.testing.assert_array_equal(np.array([row[columns["radius"]] for row in values], float), sheared.radius)
    first = columns["velo"]
    np.testing.assert_array_equal(np.array([row[first : first + 3] for row in values], float), sheared.velocity)


def test_a_trajectory_is_read_back_frame_by_frame(run_file, tmp_path, capsys):
    file = tmp_path / "r.xyz"
    assert main(["export", str(run_file), "-o", str(file)]) == 0
    number = lk.open_run(run_file).lab.number_of_snapshots
    assert number >= 3 and f", {number} snapshots, without contacts, format extended_xyz" in capsys.readouterr().out
    for frame in range(number):
        state, found = lk.read_state(run_file, snapshot=frame), read(file, frame=frame)
        np.testing.assert_array_equal(found.cell, state.cell)
        np.testing.assert_array_equal(found.position, state.position)
        np.testing.assert_array_equal(found.radius, state.radius)
    assert any(f"the last of {number} frames is read" in str(finding) for finding in read(file).findings)
    with pytest.raises(lk.InputError, match=f"frame {number} is not in .*, which has {number}"):
        read(file, frame=number)
    assert "velo" not in file.read_text().splitlines()[1]  # snapshots have no velocities


@pytest.mark.parametrize(
    ("name", "more", "said"),
    [("r.data", [], "the last of {} snapshots, without contacts"), ("r.data", ["--snapshot=0"], "snapshot 0, without"),
     ("r.xyz", ["--snapshot=1"], "snapshot 1, without contacts")],
)  # fmt: skip
def test_an_export_says_what_it_contains(run_file, tmp_path, capsys, name, more, said):
    assert main(["export", str(run_file), "-o", str(tmp_path / name), *more]) == 0
    assert said.format(lk.open_run(run_file).lab.number_of_snapshots) in capsys.readouterr().out


def test_files_of_others_are_read(tmp_path):
    """As ASE and OVITO write them: other columns, words, an open boundary."""
    text = (
        '2\nLattice="4 0 0 1 4 0 0 0 4" Properties=pos:R:3:species:S:1:Radius:R:1:forces:R:3 pbc="T T F"\n'
        "1 1 1 Si .5 0 0 0\n1.99 1 1 Si .5 0 0 0\n"
    )
    (tmp_path / "a.extxyz").write_text(text)
    found = read(tmp_path / "a.extxyz", length_unit="mm")
    np.testing.assert_allclose(found.cell, 1e-3 * np.array([[4, 1, 0], [0, 4, 0], [0, 0, 4]]))
    np.testing.assert_allclose(found.radius, 5e-4)
    assert any("not periodic in z" in str(finding) for finding in found.findings)
    (tmp_path / "b.xyz").write_text(text.replace('Lattice="4 0 0 1 4 0 0 0 4" ', "").replace("Radius:R:1", "mass:R:1"))
    with pytest.raises(lk.InputError, match=r"no periodic box: give --box.*no grain sizes: give --diameter"):
        read(tmp_path / "b.xyz", length_unit="mm")
    (tmp_path / "c.xyz").write_text(text.replace("4 0 0 1 4", "4 0 0 1"))
    with pytest.raises(lk.InputError, match=r"is damaged .*Lattice has 8 numbers, not 9"):
        read(tmp_path / "c.xyz", length_unit="mm")


@pytest.mark.parametrize(
    ("properties", "message"),
    [("pos:R", "Properties does not consist"), ("pos:R:3:x:R:999999999999", "Properties does not consist"),
     ("pos:R:3:radius:R:1", "row 1 has 5 numbers for 4 columns")],
)  # fmt: skip
def test_columns_that_are_not_there_are_named(tmp_path, properties, message):
    (tmp_path / "a.xyz").write_text(f"1\nProperties={properties}\nX 1 1 1 .5\n")
    with pytest.raises(lk.InputError, match=message):
        read(tmp_path / "a.xyz", length_unit="mm", box="4")
