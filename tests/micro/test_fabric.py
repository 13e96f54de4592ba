import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.micro.fabric import contact_anisotropy, statistics
from labkit.micro.snapshot import Contacts
from tests.contact_sets import E, snapshot_of


def draw_normals(A, n, rng):
    """Unit vectors (n, 3) drawn from E(n) = (1 + n.A n)/(4 pi) by rejection sampling."""
    top = 1.0 + np.abs(np.linalg.eigvalsh(A)).max()
    kept = np.zeros((0, 3))
    while len(kept) < n:
        v = rng.normal(size=(4 * n, 3))
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        kept = np.concatenate([kept, v[rng.random(len(v)) * top < 1.0 + np.einsum("ci,ij,cj->c", v, A, v)]])
    return kept[:n]


@pytest.mark.parametrize("A", [np.zeros((3, 3)), [[-0.2, 0.1, 0.05], [0.1, -0.25, 0.0], [0.05, 0.0, 0.45]]])
def test_the_anisotropy_of_drawn_normals_is_recovered(A):
    A = np.asarray(A)
    n = 40_000
    found = contact_anisotropy(draw_normals(A, n, np.random.default_rng(1)))
    sampling_error = 7.5 * np.sqrt(4 / 45 / n)  # error of a diagonal component of isotropic normals
    assert np.abs(found - A).max() < 4.0 * sampling_error
    assert abs(np.trace(found)) < 1e-12


def test_the_force_anisotropy_of_a_drawn_distribution_is_recovered():
    """Lambda_n(n) = Lam (1 + n.F n) on normals drawn from A, and tangential forces T n with a known tensor T."""
    A = np.diag([-0.2, -0.25, 0.45])
    F = np.array([[-0.3, 0.1, 0.0], [0.1, -0.4, 0.05], [0.0, 0.05, 0.7]])
    T = np.diag([-0.03, -0.03, 0.06])
    n = 60_000
    normal = draw_normals(A, n, np.random.default_rng(2))
    radius = np.full(4, 85e-6)
    grain = np.tile([0, 1], (n, 1))
    diameter = 170e-6
    scale = np.pi * diameter**2 * E / 3  # force of Lambda = 1, without overlap
    fn = scale * 0.01 * (1 + np.einsum("ci,ij,cj->c", normal, F, normal))
    ft = -scale * 0.01 * (normal @ T - np.einsum("ci,ij,cj->c", normal, T, normal)[:, None] * normal)
    found = statistics(snapshot_of(radius, Contacts(grain, normal, np.zeros(n), fn, ft, np.zeros((n, 3)))))
    assert np.isclose(found.mean_normalised_force, 0.01, rtol=0.01)
    np.testing.assert_allclose(found.normal_force_anisotropy, F, atol=0.05)
    # <n (x) (T n - (n.T n) n)> = T/3 - 2/15 T = T/5 over the isotropic sphere
    np.testing.assert_allclose(found.mobilisation, T / 5, atol=0.002)


def test_statistics_equal_the_sums_over_both_sides_in_the_paper(random_contacts):
    snapshot = random_contacts(300)
    contacts, radius = snapshot.contacts, snapshot.radius
    sides = []
    for k in range(len(contacts)):
        force = -contacts.normal_force[k] * contacts.normal[k] + contacts.tangential_force[k]
        for g, n, f in ((0, contacts.normal[k], force), (1, -contacts.normal[k], -force)):
            D = 2 * radius[contacts.grain[k, g]]
            Lambda = 3 * (1 - contacts.overlap[k] / D) * f / (np.pi * D**2) / E
            sides.append((n, -Lambda @ n, Lambda - (Lambda @ n) * n))
    nn = np.mean([np.outer(n, n) for n, _, _ in sides], axis=0)
    A = 7.5 * (nn - np.eye(3) / 3)
    Lam = np.mean([Ln / (1 + n @ A @ n) for n, Ln, _ in sides])
    F = 7.5 * (np.mean([Ln * np.outer(n, n) / (1 + n @ A @ n) for n, Ln, _ in sides], axis=0) / Lam - np.eye(3) / 3)
    Ft = np.mean([-np.outer(n, Lt) / (1 + n @ A @ n) for n, _, Lt in sides], axis=0) / Lam
    found = statistics(snapshot)
    assert np.isclose(found.coordination_number, 600 / 50)
    np.testing.assert_allclose(found.contact_anisotropy, A, rtol=1e-10, atol=1e-14)
    assert np.isclose(found.mean_normalised_force, Lam, rtol=1e-12)
    np.testing.assert_allclose(found.normal_force_anisotropy, F, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found.mobilisation, Ft, rtol=1e-10, atol=1e-12)


@settings(max_examples=30)
@given(n=st.integers(0, 3), seed=st.integers(0, 10))
def test_few_contacts_raise_no_error_and_no_warning(n, seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    contacts = Contacts(np.tile([0, 1], (n, 1)), normal, np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)))
    found = statistics(snapshot_of(np.full(5, 1e-4), contacts))
    assert found.coordination_number == 2 * n / 5
    assert found.mean_normalised_force == 0.0
    if n == 0:
        assert np.isnan(found.contact_anisotropy).all() and np.isnan(found.mobilisation).all()
