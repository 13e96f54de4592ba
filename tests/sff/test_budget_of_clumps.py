"""Error budget of C0 for clumps, whose contact vectors are not parallel to the contact normals."""

import dataclasses

import numpy as np

from labkit.micro.snapshot import contact_arms, love_stress
from labkit.sff.budget import PARTS, error_budget, standard_errors
from labkit.sff.c0 import sff_stress
from tests.contact_sets import make


def with_vectors(snapshot, tilt, seed=1):
    """The snapshot with contact vectors of the lengths of spheres, turned away from the normals by about `tilt`."""
    n = snapshot.contacts.normal
    along = np.stack([n, -n], axis=1) + tilt * np.random.default_rng(seed).normal(size=(len(n), 2, 3))
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    contacts = dataclasses.replace(snapshot.contacts, vectors=contact_arms(snapshot)[:, :, None] * along)
    return dataclasses.replace(snapshot, contacts=contacts)


def test_equal_clumps_carry_equal_stress():
    clumps = with_vectors(make(3, 400, 40, 1.0, 0.2), 0.3)
    parts, size = error_budget(clumps), np.abs(love_stress(clumps)).max()
    assert list(parts) == list(standard_errors(clumps, samples=3)) == list(PARTS)
    assert (
        np.abs(parts["equal_stress"]).max()
        < 1e-12 * size
        < 1e-3 * np.abs(sff_stress(clumps) - love_stress(clumps)).max()
    )


def test_vectors_along_the_normals_cost_nothing():
    """The parts are then those of spheres, and the error of grains of different sizes is that of the sizes."""
    spheres = make(3, 400, 40, 1.5, 0.2)
    parts, known = error_budget(with_vectors(spheres, 0.0)), error_budget(spheres)
    assert list(known) == list(PARTS)
    size = np.abs(love_stress(spheres)).max()
    assert size < 1e12 * np.abs(known["equal_stress"]).max()
    for name in PARTS:
        np.testing.assert_allclose(parts[name], known[name], atol=1e-12 * size)
