"""Meshes of a run for PyVista, read back by PyVista."""

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError

pyvista = pytest.importorskip("pyvista")


def test_the_meshes_hold_grains_contacts_and_cell(run_file):
    run = lk.Run.open(run_file)
    snapshot, blocks = run.snapshots[-1], run.to_pyvista()
    assert blocks.keys() == ["grains", "contacts", "cell"]
    grains, contacts, cell = (blocks[name] for name in blocks.keys())
    assert grains.n_points == snapshot.number_of_grains and contacts.n_cells == len(snapshot.contacts)
    np.testing.assert_allclose(grains["diameter"], 2.0 * snapshot.radius, rtol=1e-6)
    np.testing.assert_allclose(grains.points, snapshot.wrapped_position, atol=1e-9)
    assert cell.volume == pytest.approx(snapshot.volume, rel=1e-5)
    lengths = contacts.compute_cell_sizes()["Length"]
    np.testing.assert_allclose(lengths, snapshot.contacts.branch_length(snapshot.radius), rtol=1e-5)
    np.testing.assert_allclose(cell["stress"].reshape(3, 3), lk.love_stress(snapshot), rtol=1e-5, atol=1.0)
    spheres = grains.glyph(geom=pyvista.Sphere(), scale="diameter", factor=1.0, orient=False)
    assert spheres.bounds[1] > grains.bounds[1]


def test_another_snapshot_and_one_that_does_not_exist(run_file):
    run = lk.Run.open(run_file)
    assert run.to_pyvista(0)["contacts"].n_cells == len(run.snapshots[0].contacts)
    with pytest.raises((InputError, IndexError), match="snapshot"):
        run.to_pyvista(10**6)
