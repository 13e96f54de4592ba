"""Random sets of contacts for property tests: any number, sizes far apart, directions from isotropic to one line."""

import numpy as np
from hypothesis import strategies as st

from labkit.grains.scene import Scene
from labkit.micro.snapshot import NO_CONTACTS, Contacts, Snapshot

E = 0.15e9


def snapshot_of(radius, contacts=NO_CONTACTS, volume=1e-9):
    """A Snapshot of the Scene of Table 1, with E = 0.15 GPa, in a cube."""
    scene = Scene()
    assert scene.young_modulus == E
    return Snapshot(scene, np.asarray(radius, dtype=float), np.eye(3) * volume ** (1 / 3), contacts)


def make(seed, contacts, grains, size_ratio, anisotropy):
    """A Snapshot. `anisotropy`: 0 isotropic, towards 1 all normals lie along a random axis."""
    rng = np.random.default_rng(seed)
    radius = 1e-4 * rng.uniform(1.0, size_ratio, grains)
    pair = np.array([rng.choice(grains, 2, replace=False) for _ in range(contacts)], dtype=int).reshape(-1, 2)
    axis = rng.normal(size=3)
    normal = (1.0 - anisotropy) * rng.normal(size=(contacts, 3))
    normal += anisotropy * rng.choice([-1.0, 1.0], (contacts, 1)) * axis
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangential = rng.normal(size=(contacts, 3)) * 1e-3
    tangential -= np.einsum("ci,ci->c", tangential, normal)[:, None] * normal
    overlap = rng.uniform(1e-4, 0.05, contacts) * radius.min()
    force = overlap * rng.uniform(0.5, 2.0, contacts) * 2e4
    found = Contacts(pair, normal, overlap, force, tangential, np.zeros((contacts, 3)))
    return snapshot_of(radius, found, float(rng.uniform(1.2, 2.5) * 4 / 3 * np.pi * np.sum(radius**3)))


contact_sets = st.builds(
    make,
    seed=st.integers(0, 10**6),
    contacts=st.sampled_from([0, 1, 2, 3, 40, 300]),
    grains=st.integers(2, 40),
    size_ratio=st.sampled_from([1.0, 1.5, 5.0]),
    anisotropy=st.sampled_from([0.0, 0.5, 0.95]),
)
