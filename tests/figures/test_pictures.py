"""Pictures of grains and contacts, and files for ParaView, read back without the library that wrote them."""

import base64
import sys
import zlib
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.image import imread

import labkit
from labkit.cli import main
from labkit.figures import paraview, render
from labkit.figures.picture import draw_grains
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.micro.grains import grain_fabric, grain_stress
from labkit.micro.stress import love_stress
from labkit.runs.dataset import snapshots

TYPES = {"Float32": "<f4", "Int32": "<i4", "Int64": "<i8", "UInt8": "u1"}


def read_vtu(path):
    """Arrays of a VTK XML file by name, decoded from zlib blocks in base64 according to VTK's file format."""
    arrays = {}
    for element in ElementTree.parse(path).iter("DataArray"):
        text = element.text.strip()
        blocks = int(np.frombuffer(base64.b64decode(text[:8])[:4], "<u4")[0])
        head = 4 * -(-4 * (3 + blocks) // 3)  # characters: base64 encodes 3 bytes as 4 characters, padded
        sizes = np.frombuffer(base64.b64decode(text[:head]), "<u4")[3:]
        data, packed, at = b"", base64.b64decode(text[head:]), 0
        for size in sizes:
            data += zlib.decompress(packed[at : at + size])
            at += size
        values = np.frombuffer(data, TYPES[element.get("type")])
        parts = int(element.get("NumberOfComponents", 1))
        arrays[element.get("Name")] = values.reshape(-1, parts) if parts > 1 else values
    return arrays


@pytest.fixture(scope="module")
def series(run_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paraview") / "small"
    assert main(["paraview", str(run_file), "-o", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def last(run_file):
    return next(snapshots(run_file, [-1]))


def test_every_snapshot_is_listed_at_its_time(series, run_file):
    run = labkit.open_run(run_file)
    for name in ("grains", "contacts", "cell"):
        found = list(ElementTree.parse(series / f"{name}.pvd").iter("DataSet"))
        assert [float(f.get("timestep")) for f in found] == run["time"].values[run["record"].values].tolist()
        assert all((series / f.get("file")).is_file() for f in found)


def test_forces_along_the_lines_add_up_to_love_s_stress(series, last):
    lines = read_vtu(series / f"contacts_{last.number:04d}.vtu")
    corners = read_vtu(series / f"cell_{last.number:04d}.vtu")["Points"]
    ends = lines["Points"].astype(float)[lines["connectivity"].reshape(-1, 2)]
    volume = np.linalg.det(corners[[1, 3, 4]].astype(float))
    stress = -(ends[:, 1] - ends[:, 0]).T @ lines["force_on_first"].astype(float) / volume
    np.testing.assert_allclose(stress, love_stress(last), atol=1e-5 * np.trace(love_stress(last)))


def test_numbers_of_grains_contacts_and_their_points(series, last):
    grains, lines = (read_vtu(series / f"{name}_{last.number:04d}.vtu") for name in ("grains", "contacts"))
    assert len(grains["Points"]) == len(grains["types"]) == len(last.radius) and set(grains["types"]) == {1}
    assert len(lines["types"]) == len(last.contacts) and set(lines["types"]) == {3}
    assert len(lines["Points"]) == 2 * len(last.contacts) == grains["coordination_number"].sum()
    periods = grains["Points"] @ np.linalg.inv(last.cell).T
    assert periods.min() >= 0.0 and periods.max() <= 1.0 + 1e-6
    np.testing.assert_allclose(lines["normalised_force_over_mean"].mean(), 1.0, rtol=1e-5)
    assert 0 < lines["strong"].sum() < 0.5 * len(lines["strong"])


def test_no_contact_is_longer_than_two_radii_and_it_ends_at_an_image_of_its_grain(series, last):
    grains, lines = (read_vtu(series / f"{name}_{last.number:04d}.vtu") for name in ("grains", "contacts"))
    ends = lines["Points"].reshape(-1, 2, 3)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    first, second = lines["first_grain"], lines["second_grain"]
    touch = 0.5 * (grains["diameter"][first] + grains["diameter"][second])
    np.testing.assert_allclose(length, touch - lines["overlap"], rtol=1e-5)
    assert (length <= touch * (1 + 1e-5)).all()
    periods = (ends[:, 1] - grains["Points"][second]) @ np.linalg.inv(last.cell).T
    np.testing.assert_allclose(periods, np.round(periods), atol=1e-5)
    assert ((np.abs(np.round(periods)).max(axis=1) > 0) == (lines["periodic"] == 1)).all()
    assert 0 < lines["periodic"].sum() < len(length)


def test_vtk_reads_them(series, last):
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(series / f"contacts_{last.number:04d}.vtu"))
    reader.Update()
    assert reader.GetOutput().GetNumberOfCells() == len(last.contacts)


def test_stresses_of_grains_add_up_to_the_stress_of_the_cell(last):
    volume = 4.0 / 3.0 * np.pi * last.radius**3
    total = np.einsum("g,gij->ij", volume, grain_stress(last)) / last.volume
    np.testing.assert_allclose(total, love_stress(last), rtol=1e-9, atol=1e-6)
    trace = np.trace(grain_fabric(last), axis1=1, axis2=2)
    np.testing.assert_allclose(trace, np.isin(np.arange(len(trace)), last.contacts.grain), atol=1e-12)


def test_a_state_file_has_velocities(specimen_file, tmp_path):
    assert main(["paraview", str(specimen_file), "-o", str(tmp_path / "p")]) == 0
    state = next(snapshots(specimen_file))
    found = read_vtu(tmp_path / "p" / "grains_0000.vtu")
    np.testing.assert_allclose(found["velocity"], state.velocity, rtol=1e-6)


def test_a_picture_is_the_same_every_time(run_file, tmp_path):
    for name in ("a.png", "b.png"):
        assert main(["picture", str(run_file), "-o", str(tmp_path / name)]) == 0
    a, b = (imread(tmp_path / name) for name in ("a.png", "b.png"))
    assert (a == b).all()
    half = a.shape[1] // 2
    for panel in (a[:, :half], a[:, half:]):
        assert 0.2 < (panel[..., :3].min(axis=-1) < 0.98).mean() < 0.9


def test_grains_without_contacts_can_be_shown(tmp_path):
    scene = Scene()
    apart = grains_in_cell(scene, np.full(2, 1e-4), np.array([[1e-4] * 3, [6e-4] * 3]), np.eye(3) * 1e-3)
    snapshot = apart.snapshot()
    assert not len(snapshot.contacts)
    draw_grains([snapshot])
    paraview.write_series([snapshot], tmp_path)
    assert read_vtu(tmp_path / "grains_0000.vtu")["coordination_number"].tolist() == [0, 0]


@pytest.mark.parametrize("command", ["picture", "paraview"])
def test_bad_input(command, run_file, specimen_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for arguments, message in (
        ([run_file, "--snapshot", 99], "99"),
        ([specimen_file, "--snapshot", 0], "snapshot 0 is for run files"),
        (["nothing.run.nc"], "does not exist"),
        ([run_file, "-o", "no/f.png"] if command == "picture" else [run_file, "-o", run_file], "-o"),
    ):
        assert main([command, *map(str, arguments)]) == 2
        error = capsys.readouterr().err
        assert message in error and len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_without_meshio_the_message_names_what_to_install(run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "meshio", None)
    assert main(["paraview", str(run_file), "-o", str(tmp_path / "p")]) == 2
    assert "pip install" in capsys.readouterr().err and not (tmp_path / "p").exists()


FLAT = np.eye(3)  # x to the right, y up, z towards the viewer
RED = np.array([[1.0, 0.0, 0.0]])


def empty(width=200):
    return render.canvas(FLAT, (-1.0, -1.0), (1.0, 1.0), width)


def test_a_sphere_covers_its_disc_and_rises_to_its_radius():
    on = empty()
    render.draw_spheres(on, np.array([[0.1, -0.2, 3.0]]), np.array([0.5]), RED)
    assert abs(np.isfinite(on.depth).sum() * on.pixel**2 - np.pi * 0.25) < 2e-3
    assert abs(on.depth.max() - 3.5) < 1e-4
    there = np.isfinite(on.depth)
    np.testing.assert_allclose(np.linalg.norm(on.normal[there], axis=1), 1.0)


def test_the_nearer_sphere_hides_the_other_in_any_order():
    centre, radius = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.5, 0.3])
    color = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    pictures = []
    for order in ([0, 1], [1, 0]):
        on = empty()
        render.draw_spheres(on, centre[order], radius[order], color[order])
        pictures.append(on.color)
    assert (pictures[0] == pictures[1]).all() and (pictures[0][200, 200] == color[1]).all()


@pytest.mark.parametrize("tilt", [0.0, 0.7, np.pi / 2])
def test_the_area_and_height_of_a_stick_at_every_tilt_towards_the_viewer(tilt):
    on, r, length = empty(), 0.1, 0.8
    end = length * np.array([[np.cos(tilt), 0.0, np.sin(tilt)]])
    render.draw_sticks(on, np.zeros((1, 3)), end, np.array([r]), RED)
    area = 2 * r * length * np.cos(tilt) + np.pi * r**2  # a stadium
    assert abs(np.isfinite(on.depth).sum() * on.pixel**2 - area) < 2e-3
    there = np.isfinite(on.depth)
    np.testing.assert_allclose(np.linalg.norm(on.normal[there], axis=1), 1.0, atol=1e-9)
    top = r / np.cos(tilt) if tilt < 0.1 else length * np.sin(tilt) + r
    assert abs(on.depth.max() - top) < 1e-3


def test_spheres_behind_the_faces_fade_and_spheres_on_the_faces_do_not():
    on = render.canvas(render.view_from(30.0, 20.0), (-3.0, -3.0), (3.0, 3.0), 100)
    render.draw_spheres(
        on,
        np.array([[2.0, 1.0, 1.0], [1.0, 2.0, 1.0]]) - [[0.0, 0, 0], [0, 1.0, 0]],
        np.array([1e-1, 1e-1]),
        np.ones((2, 3)),
    )
    white = render.haze(on, 2.0 * np.eye(3), 0.5)
    centres = np.array([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0]]) @ on.view.T
    at = [white[int((y - on.corner[1]) / on.pixel), int((x - on.corner[0]) / on.pixel)] for x, y, _ in centres]
    assert at[0] == 0.0 and at[1] > 0.8
    assert (white[~np.isfinite(on.depth)] == 0.0).all()
