"""Error budget of C0 for clumps, whose contact vectors are not parallel to the contact normals."""

import dataclasses

import numpy as np
import pytest

from labkit.micro.branches import stress_along_normals
from labkit.micro.snapshot import contact_arms, love_stress
from labkit.sff.budget import BRANCHES, PARTS, PARTS_OF_CLUMPS, error_budget, standard_errors
from labkit.sff.c0 import sff_stress
from tests.contact_sets import make


def with_vectors(snapshot, tilt, seed=1):
    """The snapshot with contact vectors of the lengths of spheres, turned away from the normals by about `tilt`."""
    n = snapshot.contacts.normal
    along = np.stack([n, -n], axis=1) + tilt * np.random.default_rng(seed).normal(size=(len(n), 2, 3))
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    contacts = dataclasses.replace(snapshot.contacts, vectors=contact_arms(snapshot)[:, :, None] * along)
    return dataclasses.replace(snapshot, contacts=contacts)


@pytest.mark.parametrize("largest", [1.0, 1.5])
def test_the_contributions_of_clumps_add_up_to_the_error(largest):
    clumps = with_vectors(make(3, 400, 40, largest, 0.2), 0.3)
    parts = error_budget(clumps)
    assert list(parts) == list(PARTS_OF_CLUMPS) and list(parts).index(BRANCHES) == list(parts).index("equal_stress") - 1
    love, c0 = love_stress(clumps), sff_stress(clumps)
    np.testing.assert_allclose(sum(parts.values()), c0 - love, atol=1e-12 * np.abs(love).max())
    assert list(standard_errors(clumps, samples=3)) == list(PARTS_OF_CLUMPS)


def test_branches_are_the_whole_cost_of_contact_vectors_along_the_normals_of_equal_grains():
    clumps = with_vectors(make(3, 400, 40, 1.0, 0.2), 0.3)
    parts, love = error_budget(clumps), love_stress(clumps)
    size = np.abs(love).max()
    np.testing.assert_allclose(parts[BRANCHES], stress_along_normals(clumps) - love, atol=1e-12 * size)
    assert np.abs(parts["equal_stress"]).max() < 1e-12 * size < 1e-3 * np.abs(parts[BRANCHES]).max()


def test_vectors_along_the_normals_cost_nothing():
    """The parts are then those of spheres, and the error of grains of different sizes is that of the sizes."""
    spheres = make(3, 400, 40, 1.5, 0.2)
    parts, known = error_budget(with_vectors(spheres, 0.0)), error_budget(spheres)
    assert list(known) == list(PARTS)
    size = np.abs(love_stress(spheres)).max()
    assert np.abs(parts[BRANCHES]).max() < 1e-12 * size < np.abs(known["equal_stress"]).max()
    for name in PARTS:
        np.testing.assert_allclose(parts[name], known[name], atol=1e-12 * size)
