"""Pictures of grains and contacts, and files for ParaView, read back by VTK, as ParaView does."""

import sys

import numpy as np
import pytest
from matplotlib.image import imread
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

import labkit
from labkit.cli import main
from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.micro.grains import grain_fabric, grain_stress
from labkit.micro.snapshot import love_stress
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.plugins.exchange import paraview
from labkit.plugins.pictures import render
from labkit.plugins.pictures.frames import view_from
from labkit.plugins.pictures.picture import draw_grains
from labkit.results.dataset import snapshots

pytestmark = pytest.mark.slow

BLOCKS = ("grains", "contacts", "cell")


def opened(file):
    """VTK's reader of a .vtkhdf file."""
    reader = vtkHDFReader()
    reader.SetFileName(str(file))
    reader.UpdateInformation()
    return reader


def read_block(file, name, number=-1):
    """Points, cells and arrays of a block at one of the times, as ParaView reads them."""
    reader = opened(file)
    reader.SetStep(number % reader.GetNumberOfSteps())
    reader.Update()
    collection = reader.GetOutputDataObject(0)
    mesh = collection.GetPartitionedDataSet(BLOCKS.index(name)).GetPartition(0)
    kinds = [mesh.GetCellType(k) for k in range(mesh.GetNumberOfCells())]
    arrays = {"Points": vtk_to_numpy(mesh.GetPoints().GetData()), "kinds": kinds}
    arrays["connectivity"] = vtk_to_numpy(mesh.GetCells().GetConnectivityArray())
    for data in (mesh.GetPointData(), mesh.GetCellData()):
        for k in range(data.GetNumberOfArrays()):
            arrays[data.GetArrayName(k)] = vtk_to_numpy(data.GetArray(k))
    return arrays


@pytest.fixture(scope="module")
def series(run_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paraview") / "small"
    assert main(["paraview", str(run_file), "-o", str(folder)]) == 0
    return folder / "snapshots.vtkhdf"


@pytest.fixture(scope="module")
def last(run_file):
    return next(snapshots(run_file, [-1]))


def test_every_snapshot_is_there_at_its_time(series, run_file):
    run = labkit.open_run(run_file)
    times = opened(series).GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert list(times) == run["time"].values[run["record"].values].tolist()
    for number, snapshot in enumerate(snapshots(run_file)):
        contacts = read_block(series, "contacts", number)
        np.testing.assert_allclose(contacts["overlap"], snapshot.contacts.overlap, rtol=1e-6)
        assert read_block(series, "cell", number)["void_ratio_nominal"] == np.float32(void_ratio_nominal(snapshot))


def test_forces_along_the_lines_add_up_to_love_s_stress(series, last):
    lines = read_block(series, "contacts")
    corners = read_block(series, "cell")["Points"]
    ends = lines["Points"].astype(float)[lines["connectivity"].reshape(-1, 2)]
    volume = np.linalg.det(corners[[1, 3, 4]].astype(float))
    stress = -(ends[:, 1] - ends[:, 0]).T @ lines["force_on_first"].astype(float) / volume
    np.testing.assert_allclose(stress, love_stress(last), atol=1e-5 * np.trace(love_stress(last)))


def test_numbers_of_grains_contacts_and_their_points(series, last):
    grains, lines = (read_block(series, name) for name in ("grains", "contacts"))
    assert len(grains["Points"]) == len(grains["kinds"]) == len(last.radius) and set(grains["kinds"]) == {1}
    assert len(lines["kinds"]) == len(last.contacts) and set(lines["kinds"]) == {3}
    assert len(lines["Points"]) == 2 * len(last.contacts) == grains["coordination_number"].sum()
    periods = grains["Points"] @ np.linalg.inv(last.cell).T
    assert periods.min() >= 0.0 and periods.max() <= 1.0 + 1e-6
    np.testing.assert_allclose(lines["normalised_force_over_mean"].mean(), 1.0, rtol=1e-5)
    assert 0 < lines["strong"].sum() < 0.5 * len(lines["strong"])


def test_no_contact_is_longer_than_two_radii_and_it_ends_at_an_image_of_its_grain(series, last):
    grains, lines = (read_block(series, name) for name in ("grains", "contacts"))
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


def test_stresses_of_grains_add_up_to_the_stress_of_the_cell(last):
    volume = 4.0 / 3.0 * np.pi * last.radius**3
    total = np.einsum("g,gij->ij", volume, grain_stress(last)) / last.volume
    np.testing.assert_allclose(total, love_stress(last), rtol=1e-9, atol=1e-6)
    trace = np.trace(grain_fabric(last), axis1=1, axis2=2)
    np.testing.assert_allclose(trace, np.isin(np.arange(len(trace)), last.contacts.grain), atol=1e-12)


def test_a_state_file_has_velocities(specimen_file, tmp_path):
    assert main(["paraview", str(specimen_file), "-o", str(tmp_path / "p")]) == 0
    state = next(snapshots(specimen_file))
    found = read_block(tmp_path / "p" / "snapshots.vtkhdf", "grains")
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
    file = paraview.write_series([snapshot], tmp_path / "s.vtkhdf")
    assert read_block(file, "grains")["coordination_number"].tolist() == [0, 0]


@pytest.mark.parametrize("command", ["picture", "paraview"])
def test_bad_input(command, run_file, specimen_file, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for arguments, message in (
        ([run_file, "--snapshot", 99], "99"),
        ([specimen_file, "--snapshot", 0], "snapshot 0 "),
        (["nothing.run.nc"], "does not exist"),
        ([run_file, "-o", "no/f.png"], "another name") if command == "picture" else ([run_file, "-o", run_file], "-o"),
    ):
        assert main([command, *map(str, arguments)]) == 2
        error = capsys.readouterr().err
        assert message in error and len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_without_h5py_the_message_names_what_to_install(run_file, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "h5py", None)
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
    on = render.canvas(view_from(30.0, 20.0), (-3.0, -3.0), (3.0, 3.0), 100)
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
