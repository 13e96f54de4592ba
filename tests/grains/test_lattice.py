"""Equivalent cells, and the same specimen in rotated axes."""

import dataclasses

import numpy as np
import pytest

import labkit as lk
from labkit.engines.fused import FusedEngine
from labkit.grains import lattice


def force_list(state):
    """Contacts as grain pairs with their normal forces, sorted."""
    contacts = state.snapshot().contacts
    order = np.lexsort((contacts.normal_force, contacts.grain[:, 1], contacts.grain[:, 0]))
    return contacts.grain[order], contacts.normal_force[order]


@pytest.mark.parametrize("shear", [0.51, 0.75, 1.3, -0.6, 7.4])
def test_a_tilted_cell_is_reduced_without_changing_a_force(sheared_state, shear):
    """The state's lattice written with a tilted cell: the reduced cell gives the same forces."""
    state, periods = sheared_state.at_rest(), np.eye(3)
    periods[0, 2] = np.round(shear)  # an equivalent cell, tilted by that many periods
    tilted = lattice.in_cell(state, periods)
    U = lattice.reduction(tilted.cell)
    reduced = lattice.in_cell(tilted, U)
    assert lattice.tilt(reduced.cell) <= lattice.MOST_TILT
    assert np.linalg.det(U) == pytest.approx(1.0) and np.array_equal(U, np.round(U))
    (pairs, forces), (same, again) = force_list(tilted), force_list(reduced)
    assert np.array_equal(pairs, same)
    np.testing.assert_allclose(again, forces, rtol=0, atol=1e-12 * forces.mean())


def test_reduction_in_the_middle_of_shear_changes_no_force(sheared_state):
    L = np.zeros((3, 3))
    L[0, 2] = -200.0
    engine = FusedEngine(sheared_state.at_rest())
    steps = int(0.55 / 200.0 / sheared_state.time_step)
    engine.advance(steps, L)
    state = engine.state()
    reduced = lattice.in_cell(state, lattice.reduction(state.cell))
    assert lattice.tilt(state.cell) > 0.5 > lattice.tilt(reduced.cell)
    before, after = state.snapshot().contacts, reduced.snapshot().contacts
    limit = 1e-12 * before.normal_force.mean()
    np.testing.assert_allclose(after.normal_force, before.normal_force, rtol=0, atol=limit)
    other = FusedEngine(reduced)
    for one in (engine, other):
        one.advance(100, L)
    np.testing.assert_allclose(other.stress(), engine.stress(), rtol=1e-9, atol=1e-9 * np.abs(engine.stress()).max())


def rotated(state, R):
    """The state in axes rotated by R (3, 3)."""
    names = ("position", "velocity", "angular_velocity", "tangential_force", "rolling_moment")
    turned = {name: getattr(state, name) @ R.T for name in names}
    return state.replace(**turned, cell=R @ state.cell, velocity_gradient=R @ state.velocity_gradient @ R.T)


@pytest.mark.parametrize("changes", [{"law": "spring_dashpot"}, {"law": "rolling_resistance", "local_damping": 0.0}])
def test_results_do_not_depend_on_the_axes(sheared_state, changes):
    """100 steps of a general velocity gradient in rotated axes: stress and fabric rotate with them.

    YADE's local damping acts on each component of a force by itself, so it depends on the axes; it is left out.
    """
    L = -np.array([[-4.0, 2.0, 6.0], [1.0, -3.0, 0.0], [0.0, 5.0, 8.0]])
    R, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    R *= np.sign(np.linalg.det(R))
    state = sheared_state.at_rest()
    state = state.replace(scene=dataclasses.replace(state.scene, **changes))
    found = []
    for start, gradient in ((state, L), (rotated(state, R), R @ L @ R.T)):
        engine = FusedEngine(start)
        engine.advance(100, gradient)
        snapshot = engine.state().snapshot()
        fabric = lk.statistics(snapshot)
        tensors = (fabric.contact_anisotropy, fabric.normal_force_anisotropy, fabric.mobilisation)
        found.append((lk.love_stress(snapshot), lk.sff_stress(snapshot), *tensors))
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(R @ here @ R.T, there, rtol=0, atol=1e-9 * np.abs(here).max())
