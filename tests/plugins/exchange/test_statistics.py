"""Statistics of foreign contact lists against a NumPy computation that shares no code with labkit."""

import itertools
import json

import numpy as np
import pytest

import labkit as lk
from labkit import import_snapshot
from labkit.grains.state_file import write_state
from labkit.plugins.exchange import FORMATS
from labkit.plugins.exchange.summary import contact_table, grain_table

pytestmark = pytest.mark.slow

E = 0.15e9
LOCAL = "-,id1,id2,-,-,fnx,fny,fnz,ftx,fty,ftz"  # index, two atoms, distance, force, its normal and tangential parts


def by_hand(position, radius, cell, pairs, normal_force, tangential):
    """Z, A, Lambda, F, F^t, Love's stress and C0 (Eqs. 4, 10, 24-27 and C0), one contact after the other."""
    volume, contacts = abs(np.linalg.det(cell)), []
    images = np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=3))) @ cell.T
    for (a, b), fn, ft in zip(pairs, normal_force, tangential, strict=True):
        branches = position[b] - position[a] + images
        branch = branches[np.argmin((branches**2).sum(axis=1))]
        length = np.linalg.norm(branch)
        overlap = radius[a] + radius[b] - length
        weight = sum((r - overlap / 2) / (4 / 3 * np.pi * r**3) for r in (radius[a], radius[b])) / 2
        contacts.append((branch / length, length, fn, ft, weight / E))
    n = np.array([each[0] for each in contacts])
    love = sum(length * np.outer(m, fn * m - ft) for m, length, fn, ft, _ in contacts) / volume
    A = 7.5 * (n.T @ n / len(n) - np.eye(3) / 3)
    shape = 1 + np.einsum("ci,ij,cj->c", n, A, n)
    scaled = np.array([w * fn for _, _, fn, _, w in contacts]) / shape
    Lam = scaled.mean()
    F = 7.5 * ((n * scaled[:, None]).T @ n / len(n) / Lam - np.eye(3) / 3)
    Ft = -sum(np.outer(m, w * ft / s) for (m, _, _, ft, w), s in zip(contacts, shape, strict=True)) / len(n) / Lam
    Z = 2 * len(n) / len(radius)
    e = volume / (4 / 3 * np.pi * (radius**3).sum()) - 1
    FA = (F @ A + A @ F) / 2
    bracket = np.eye(3) / 3 + 2 / 15 * (A + F) + 2 / 105 * np.trace(FA) * np.eye(3) + 8 / 105 * FA + Ft
    return {
        "coordination_number": Z,
        "contact_anisotropy": A,
        "mean_normalised_force": Lam,
        "normal_force_anisotropy": F,
        "mobilisation": Ft,
        "stress": love,
        "stress_sff": E * Z * Lam / (1 + e) * bracket,
    }


def require_equal(found, expected, tolerance):
    for name, value in expected.items():
        size = np.abs(value).max()
        np.testing.assert_allclose(found[name], value, rtol=tolerance, atol=tolerance * size, err_msg=name)


def of_snapshot(snapshot):
    return lk.statistics(snapshot).by_name() | {
        "stress": lk.love_stress(snapshot),
        "stress_sff": lk.sff_stress(snapshot),
    }


def of_state(state):
    contacts = state.snapshot().contacts
    force = contacts.normal_force
    return by_hand(state.position, state.radius, state.cell, contacts.grain, force, contacts.tangential_force)


def test_tables_of_a_sheared_state_agree_with_numpy(sheared, tmp_path, labkit_command):
    """In mm and N, shuffled, counted from 1, with compression negative and forces on the second grain."""
    rng = np.random.default_rng(1)
    contacts = sheared.snapshot().contacts
    order = rng.permutation(sheared.number_of_grains)
    rows = np.column_stack([order + 1, sheared.position[order] * 1e3, 2e3 * sheared.radius[order]])
    np.savetxt(tmp_path / "grains.txt", rows, header="id x y z d", fmt="%.17g")
    grain = contacts.grain + 1
    rows = np.column_stack([grain, -contacts.normal_force, -contacts.tangential_force])
    rows = rows[rng.permutation(len(rows))]
    np.savetxt(tmp_path / "c.csv", rows, header="id1,id2,fn,ftx,fty,ftz", fmt="%.17g", delimiter=",", comments="")
    box = ",".join(repr(float(value)) for value in sheared.cell.ravel() * 1e3)
    words = ("statistics", "grains.txt", "--contacts", "c.csv", f"--box={box}", "--length-unit", "mm")
    words += ("--force-unit", "N", "--force-sign", "tension", "--force-on", "second", "--json", "s.json")
    done = labkit_command(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "s.json").read_text())
    assert (found["grains"], found["contacts"]) == (sheared.number_of_grains, len(contacts))
    require_equal(found, of_state(sheared), 1e-6)


def test_a_save_of_yade_agrees_with_numpy_and_with_yades_own_stress(straight, yade_files):
    folder, yade = yade_files
    snapshot = import_snapshot(folder / "saved.yade.gz", length_unit="m", force_unit="N")
    found = of_snapshot(snapshot)
    assert len(snapshot.contacts) == yade["contacts"]
    require_equal(found, of_state(straight), 1e-6)
    np.testing.assert_allclose(found["stress"].T, yade["stress"], rtol=1e-6, atol=1.0)


def test_vtk_files_of_yade_agree_with_numpy(straight, yade_files):
    pytest.importorskip("vtkmodules", reason="vtk is not installed")
    folder, _ = yade_files
    box = ",".join(repr(float(value)) for value in straight.cell.ravel())
    snapshot = import_snapshot(
        folder / "vtk-spheres-00000000.vtk",
        contacts=folder / "vtk-intrs-00000000.vtk",
        box=box,
        length_unit="m",
        force_unit="N",
        force_sign="compression",
        force_on="second",
    )
    require_equal(of_snapshot(snapshot), of_state(straight), 1e-3)  # YADE writes six digits


@pytest.mark.parametrize("grains", ["grains.dump", "scaled.dump", "final.data"])
def test_contacts_of_lammps_agree_with_its_virial(lammps_files, grains):
    """Test a triclinic box; LAMMPS dumps its bounding box. The virial is the upper triangle of Love's stress."""
    folder, virial = lammps_files
    snapshot = import_snapshot(
        folder / grains, contacts=folder / "contacts.local", contact_columns=LOCAL, length_unit="m", force_unit="N"
    )
    love = lk.love_stress(snapshot)
    upper = np.array([love[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    np.testing.assert_allclose(upper, virial, rtol=1e-6, atol=1e-6 * love.max())
    contacts = snapshot.contacts
    expected = by_hand(
        snapshot.position, snapshot.radius, snapshot.cell, contacts.grain, contacts.normal_force,
        contacts.tangential_force,
    )  # fmt: skip
    require_equal(of_snapshot(snapshot), expected, 1e-6)


def test_statistics_of_a_state_are_those_of_its_tables(sheared, tmp_path, labkit_command):
    write_state(tmp_path / "s.state.nc", sheared)
    done = labkit_command("statistics", "s.state.nc", "--csv", "s.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = dict(line.split(",")[::2] for line in (tmp_path / "s.csv").read_text().splitlines()[1:])
    love = of_state(sheared)["stress"]
    assert float(lines["stress_xz"]) == pytest.approx(love[0, 2], rel=1e-6)
    snapshot = sheared.snapshot()
    grain_table(snapshot).to_csv(tmp_path / "g.csv", index=False)
    contact_table(snapshot).to_csv(tmp_path / "c.csv", index=False)
    box = ",".join(repr(float(value)) for value in sheared.cell.ravel())
    again = import_snapshot(
        tmp_path / "g.csv", contacts=tmp_path / "c.csv", box=box, force_sign="compression", force_on="first"
    )
    require_equal(of_snapshot(again), of_state(sheared), 1e-9)


@pytest.mark.filterwarnings("ignore:the mean")  # of two grains in 1 m3
def test_a_format_of_the_user_is_found(tmp_path):
    @lk.register_format
    class Twice(lk.exchange.Format):
        name = "twice"

        def recognises(self, file, head):
            return head.startswith("twice")

        def read(self, file, answers):
            values = np.loadtxt(file, skiprows=1)
            return lk.exchange.Packing(values[:, :3], values[:, 3], "radius", cell=np.eye(3), length_unit=1.0)

    try:
        (tmp_path / "t.txt").write_text("twice\n0.2 0.5 0.5 0.11\n0.4 0.5 0.5 0.11\n")
        state = lk.import_state(tmp_path / "t.txt")
        assert state.radius.tolist() == [0.11, 0.11] and len(state.contact_grain) == 1
    finally:
        del FORMATS._entries["twice"]
