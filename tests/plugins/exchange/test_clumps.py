"""Spheres that belong together: kept as clumps wherever a file says so, or else a note."""

import subprocess

import numpy as np
import pytest

import labkit as lk
from labkit import import_snapshot, import_state
from labkit.bodies.shapes import moments
from labkit.cli.dispatch import main
from labkit.grains.state_file import write_state
from labkit.plugins.exchange import FORMATS, read
from tests.conftest import PATIENCE

# two clumps of two spheres, whose members overlap by 2 %, and a single sphere on one of them; the second clump is cut
# by the face x = 1
PLACES = np.array([[0.1, 0.1, 0.1], [0.198, 0.1, 0.1], [0.149, 0.186, 0.1], [0.96, 0.5, 0.5], [0.058, 0.5, 0.5]])
BODIES = [7, 7, -1, 9, 9]


def table(folder, name, body=BODIES, places=PLACES):
    rows = [f"{x} {y} {z} 0.05 {owner}" for (x, y, z), owner in zip(places.tolist(), body, strict=True)]
    (folder / "g.txt").write_text(f"x y z r {name}\n" + "\n".join(rows) + "\n")
    return folder / "g.txt"


@pytest.mark.parametrize("name", ["clumpId", "clump_id", "multisphereIndex", "mol", "body", "id_multisphere", "Clump"])
@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4], [3, 0, 2, 4, 1]])
def test_clumps_of_a_table_are_kept(tmp_path, name, order):
    body = [0 if name == "mol" and owner < 0 else owner for owner in BODIES]  # LAMMPS counts molecules from 1
    found = read(table(tmp_path, name, np.array(body)[order], PLACES[order]), length_unit="mm", box="1")
    state = found.state(lk.Scene())
    assert len(state.bodies.body_volume) == 3 and "2 clumps of 4 spheres are kept" in map(str, found.findings)
    assert len(found.grain) == 2  # the single sphere touches both spheres of the first clump
    overlap = 0.1 - np.hypot(0.049, 0.086)
    np.testing.assert_allclose(state.snapshot().spheres.contacts.overlap, 1e-3 * overlap, rtol=1e-9)
    h = 0.05 - 0.098 / 2  # each sphere loses a cap of this height
    union = 2.0 * (4.0 / 3.0 * np.pi * 0.05**3 - np.pi * h**2 * (3.0 * 0.05 - h) / 3.0)
    volume = np.sort(state.clumps.body_volume)
    np.testing.assert_allclose(volume, 1e-9 * np.array([4.0 / 3.0 * np.pi * 0.05**3, union, union]), rtol=1e-4)
    members = state.clumps.body
    for one in range(3):  # a clump is not cut at a face, and its arms give the places of its spheres
        turned = state.clumps.axes()[one] @ state.clumps.arm[members == one].T
        np.testing.assert_allclose(
            state.clumps.body_position[one] + turned.T, state.position[members == one], atol=1e-12
        )


def test_the_volume_of_a_clump_is_that_of_the_fine_integration(tmp_path):
    places = np.array([[0.5, 0.5, 0.5], [0.56, 0.52, 0.5], [0.53, 0.5, 0.57]])
    state = read(table(tmp_path, "clumpId", [1, 1, 1], places), length_unit="m", box="1").state(lk.Scene())
    volume, first, _ = moments(places - 0.5, np.full(3, 0.05))
    assert state.clumps.body_volume[0] == pytest.approx(volume, rel=1e-4)
    np.testing.assert_allclose(state.clumps.body_position[0] - 0.5, first / volume, atol=1e-5)


@pytest.mark.parametrize("body", [[1, 1, -1, 2, 2], [5, 5, 5, 5, 5]])
def test_groups_that_do_not_touch_stay_separate(tmp_path, body):
    places = PLACES + np.array([[0, 0, 0], [0.1, 0, 0.3], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    found = read(table(tmp_path, "mol", body, places), length_unit="mm", box="1")
    assert any("groups of spheres are no clumps" in str(one) for one in found.findings)
    assert found.clumps is None or len(found.clumps.body_volume) == 4


def test_pebbles_of_geotaichi(tmp_path):
    """Its header and the form of its rows; three pebbles of two spheres."""
    rows = (
        "6.580961e+00 5.731342e+00 6.285483e+00 1.222300e-01 0.000000e+00",
        "6.566846e+00 5.760602e+00 6.403317e+00 1.222300e-01 0.000000e+00",
        "1.682114e+00 3.767279e-01 2.157593e+00 8.217037e-02 1.000000e+00",
        "1.683892e+00 3.006856e-01 2.188680e+00 8.217037e-02 1.000000e+00",
        "2.121524e-01 5.266500e+00 5.845457e+00 1.151691e-01 2.000000e+00",
        "2.674919e-01 5.353235e+00 5.793701e+00 1.151691e-01 2.000000e+00",
    )
    header = "#      PositionX            PositionY         PositionZ           Radius        multisphereIndex"
    (tmp_path / "p.txt").write_text("\n".join([header, *rows]) + "\n")
    for columns in (None, "x,y,z,radius,multisphereIndex"):
        found = read(tmp_path / "p.txt", length_unit="mm", box="7", columns=columns)
        assert "3 clumps of 6 spheres are kept" in map(str, found.findings) and len(found.grain) == 0


@pytest.mark.slow
def test_clumps_of_a_save_of_yade(tmp_path):
    (tmp_path / "make.py").write_text(
        "O.periodic = True\nO.cell.setBox(1, 1, 1)\nO.materials.append(FrictMat())\n"
        "pair = [sphere((0.1, 0.1, 0.1), 0.05), sphere((0.18, 0.1, 0.1), 0.05)]\n"
        "O.bodies.append(sphere((0.5, 0.5, 0.5), 0.05))\nO.bodies.appendClumped(pair)\nO.save('s.yade.gz')\n"
    )
    done = subprocess.run(
        ["yade", "-n", "-x", "make.py"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = read(tmp_path / "s.yade.gz", length_unit="m")
    assert "1 clumps of 2 spheres are kept" in map(str, found.findings)
    assert len(found.clumps.body_volume) == 2 and len(found.grain) == 0


@pytest.fixture(scope="module")
def clumps(tmp_path_factory):
    recipe = lk.Recipe(void_ratio=0.6, grains=120, shape="rod aspect_ratio=1.6 members=2", cell="fixed")
    state = lk.make_specimen(recipe, lk.Scene(), progress=False)
    file = tmp_path_factory.mktemp("clumps") / "c.state.nc"
    write_state(file, state)
    return file, state


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.* lie outside the box", "ignore:.* are kept")
def test_clumps_survive_ondem(clumps, tmp_path):
    pytest.importorskip("h5py", reason="h5py is not installed")
    _, state = clumps
    FORMATS["ondem"]().write(state, tmp_path / "c.vtkhdf")
    found = import_state(tmp_path / "c.vtkhdf", state.scene)
    np.testing.assert_array_equal(found.contact_grain, state.contact_grain)
    np.testing.assert_allclose(found.clumps.body_volume, state.clumps.body_volume, rtol=1e-4)
    love = lk.love_stress(state.snapshot())
    again = lk.love_stress(import_snapshot(tmp_path / "c.vtkhdf", state.scene))
    np.testing.assert_allclose(again, love, atol=1e-6 * love.max())


@pytest.mark.slow
@pytest.mark.parametrize("name, said", [("c.data", True), ("c.spheres", True), ("c.csv", True), ("c.vtkhdf", False)])
def test_exports_say_what_clumps_lose(clumps, tmp_path, name, said, capsys):
    if name == "c.vtkhdf":
        pytest.importorskip("h5py", reason="h5py is not installed")
    assert main(["export", str(clumps[0]), "--output", str(tmp_path / name)]) == 0
    assert ("labkit: note: " in capsys.readouterr().err) == said
