import numpy as np
import pytest

from labkit.micro.snapshot import Contacts
from tests.contact_sets import snapshot_of


@pytest.fixture
def random_contacts():
    """Function that returns a Snapshot of n random contacts between grains of different size, in a cell of 1e-9 m3."""

    def make(n, grains=50, seed=0):
        rng = np.random.default_rng(seed)
        radius = rng.uniform(0.8, 1.2, grains) * 85e-6
        pair = np.array([rng.choice(grains, 2, replace=False) for _ in range(n)], dtype=int).reshape(-1, 2)
        normal = rng.normal(size=(n, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        tangential = rng.normal(size=(n, 3)) * 1e-3
        tangential -= np.einsum("ci,ci->c", tangential, normal)[:, None] * normal
        overlap = rng.uniform(0.0, 0.02, n) * radius.min()
        return snapshot_of(radius, Contacts(pair, normal, overlap, overlap * 2e4, tangential, np.zeros((n, 3))))

    return make
