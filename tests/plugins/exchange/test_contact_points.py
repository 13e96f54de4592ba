"""Contact points in contact lists: grains of any shape, compared with clumps of labkit and polyhedra of YADE."""

import json
import subprocess

import numpy as np
import pytest

import labkit as lk
from labkit import import_snapshot, import_state
from labkit.micro.snapshot import OUTWARD, contact_arms
from tests.conftest import PATIENCE
from tests.plugins.exchange.conftest import IN_YADE
from tests.plugins.exchange.test_statistics import of_snapshot, require_equal

pytestmark = pytest.mark.slow
UNITS = {"length_unit": "m", "force_unit": "N", "force_sign": "compression", "force_on": "first"}


@pytest.fixture(scope="module")
def rods():
    """A Snapshot of 100 rods at rest in shear, with several contacts per pair and contacts across faces."""
    scene = lk.Scene(friction=0.5, rolling_friction=0.0)
    state = lk.make_specimen(lk.Recipe(0.55, grains=100, shape="rod aspect_ratio=2.0"), scene)
    return lk.run(state, lk.paths.ConstantVolume(strain=0.005, rate=100.0), snapshots=1).snapshots[-1]


def tables(folder, snapshot, flip=False, header="point_x,point_y,point_z"):
    """Tables of grains and contacts with points on the first side; with `flip` every second contact is reversed."""
    contacts, rng = snapshot.contacts, np.random.default_rng(3)
    position = snapshot.position + rng.integers(-1, 2, snapshot.position.shape) @ snapshot.cell.T  # any image
    np.savetxt(folder / "g.txt", np.column_stack([position, snapshot.radius]), header="x y z r", fmt="%.17g")
    vectors = contacts.vectors
    if vectors is None:
        vectors = contact_arms(snapshot)[:, :, None] * contacts.normal[:, None] * OUTWARD[:, None]
    point = position[contacts.grain[:, 0]] + vectors[:, 0]
    grain, force = contacts.grain.copy(), contacts.tangential_force.copy()
    normal = contacts.normal * rng.choice([-2.0, 0.5], (len(contacts), 1))  # neither the sign nor the length matters
    if flip:
        grain[::2], force[::2] = grain[::2, ::-1], -force[::2]
    rows = np.column_stack([grain, point, normal, contacts.normal_force, force])
    names = f"id1,id2,{header},nx,ny,nz,fn,ftx,fty,ftz"
    rows = rows[rng.permutation(len(rows))]
    np.savetxt(folder / "c.csv", rows, header=names, fmt="%.17g", delimiter=",", comments="")
    box = ",".join(repr(float(value)) for value in snapshot.cell.ravel())
    return {"file": folder / "g.txt", "contacts": folder / "c.csv", "box": box, "first_id": 0, **UNITS}


@pytest.mark.parametrize("flip", [False, True])
def test_clumps_by_their_contact_points_have_the_statistics_of_clumps(rods, tmp_path, flip):
    assert rods.contacts.vectors is not None and len(np.unique(rods.contacts.grain, axis=0)) < len(rods.contacts)
    found = import_snapshot(**tables(tmp_path, rods, flip))
    require_equal(of_snapshot(found), of_snapshot(rods), 1e-9)
    assert np.abs(lk.statistics(found).normal_force_eccentricity).max() > 1e-3


def test_polyhedra_of_yade_have_the_stress_of_their_forces(tmp_path, labkit_command):
    command = ["yade", "-n", "-x", str(IN_YADE / "polyhedra.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout[-2000:]
    yade = json.loads((tmp_path / "result.json").read_text())
    words = ("statistics", "grains.csv", "--contacts", "contacts.csv", "--box", str(yade["side"]), "--json", "s.json")
    done = labkit_command(*words, "--force-unit", "N", "--force-on", "second", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "sphere of equal volume" in done.stderr
    found = json.loads((tmp_path / "s.json").read_text())
    assert found["contacts"] == yade["contacts"] > 10
    assert found["void_ratio"] == pytest.approx(yade["e"], rel=1e-9)
    np.testing.assert_allclose(found["stress"], yade["stress"], rtol=1e-9, atol=1e-9 * np.abs(yade["stress"]).max())
    assert np.isfinite(found["stress_sff"]).all() and np.abs(found["normal_force_eccentricity"]).max() > 1e-3


def test_points_of_spheres_change_nothing(sheared, tmp_path):
    given = tables(tmp_path, sheared.snapshot())
    found = import_snapshot(**given)
    assert found.contacts.vectors is None
    require_equal(of_snapshot(found), of_snapshot(sheared.snapshot()), 1e-6)
    with pytest.warns(UserWarning):
        assert import_state(**given, accept=True).number_of_grains == sheared.number_of_grains


def test_a_list_without_normals_or_forces_says_what_is_missing(rods, tmp_path):
    given = tables(tmp_path, rods)
    columns = "id1,id2,point_x,point_y,point_z,{normal},{force}"
    bare = given | {"contact_columns": columns.format(normal="-,-,-", force="fn,ftx,fty,ftz")}
    with pytest.raises(lk.InputError, match="nx,ny,nz"):
        import_snapshot(**bare)
    silent = given | {"contact_columns": columns.format(normal="nx,ny,nz", force="-,-,-,-")}
    with pytest.raises(lk.InputError, match="no contact forces"):
        import_snapshot(**{name: silent[name] for name in silent if name not in ("force_sign", "force_on")})


@pytest.mark.filterwarnings("ignore:the grains extend", "ignore:contact points are given")
def test_a_state_of_other_grains_is_refused(rods, tmp_path):
    with pytest.raises(lk.InputError, match="labkit statistics"):
        import_state(**tables(tmp_path, rods))


def test_points_in_another_unit_or_on_the_wrong_side_are_doubted(rods, tmp_path):
    given = tables(tmp_path, rods, header="point_x [mm],point_y [mm],point_z [mm]")
    with pytest.raises(lk.InputError, match="centres of their grains"):
        import_snapshot(**given)
    given = tables(tmp_path, rods)
    text = (tmp_path / "c.csv").read_text().splitlines()
    cells = text[1].split(",")
    (tmp_path / "c.csv").write_text("\n".join([text[0], ",".join([*cells[:2], "1e300", *cells[3:]]), *text[2:]]) + "\n")
    with pytest.raises(lk.InputError, match="boxes away"):
        import_snapshot(**given)
    with pytest.raises(lk.InputError, match="one unit"):
        import_snapshot(**tables(tmp_path, rods, header="point_x [mm],point_y [mm],point_z"))
