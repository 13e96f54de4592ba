"""Fits on the sphere compared with quadrature and with functions of known coefficients."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import lebedev_rule
from scipy.special import eval_legendre

from labkit.micro.directions import bin_means, hemisphere_bins, polar_bins
from labkit.micro.fabric import (
    DirectionalFit,
    directional_fit,
    directional_mean,
    normal_density,
    tangential_mean,
    traceless,
)
from tests.contact_sets import contact_sets

n_, w_ = lebedev_rule(17)
n, weight = n_.T, w_ / (4 * np.pi)  # mean over the sphere, exact to degree 17


def random_tensors(seed, second=0.5, fourth=0.3):
    """A deviatoric B and a symmetric traceless B4, not coaxial with it."""
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(3, 3))
    B = B + B.T - 2 * np.trace(B) / 3 * np.eye(3)
    v = rng.normal(size=(4, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    S = sum(np.einsum("i,j,k,l->ijkl", x, x, x, x) for x in v)
    B4 = traceless(S)
    return second * B / np.linalg.norm(B), fourth * B4 / np.linalg.norm(B4)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_the_coefficients_of_a_known_function_are_recovered(seed):
    B, B4 = random_tensors(seed)
    known = DirectionalFit(2.5, B, B4)
    values = 2.5 * (1 + np.einsum("mi,ij,mj->m", n, B, n) + np.einsum("ijkl,mi,mj,mk,ml->m", B4, n, n, n, n))
    np.testing.assert_allclose(known.at(n), values, rtol=1e-12)
    found = directional_fit(n, len(n) * weight * values, 4)
    assert np.isclose(found.mean, 2.5, rtol=1e-12)
    np.testing.assert_allclose(found.second, B, atol=1e-12)
    np.testing.assert_allclose(found.fourth, B4, atol=1e-12)
    np.testing.assert_allclose(directional_fit(n, len(n) * weight * values, 2).second, B, atol=1e-12)


def test_axisymmetric_coefficients_are_legendre_coefficients():
    """f = 1 + a2 P2 + a4 P4 with the angle from z: B_zz = a2, B4_zzzz = a4, as P2(1) = P4(1) = 1."""
    a2, a4 = 0.4, -0.15
    values = 1 + a2 * eval_legendre(2, n[:, 2]) + a4 * eval_legendre(4, n[:, 2])
    found = directional_fit(n, len(n) * weight * values, 4)
    assert np.isclose(found.second[2, 2], a2) and np.isclose(found.fourth[2, 2, 2, 2], a4)
    np.testing.assert_allclose(np.diag(found.second), [-a2 / 2, -a2 / 2, a2], atol=1e-12)
    np.testing.assert_allclose(found.at(n), values, rtol=1e-12)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_a_directional_mean_does_not_depend_on_the_density_of_contacts(seed):
    """Lambda_n(n) and t(n) from rows with the density E_PDF(n), weighted by 1/(1 + n.A n + A4::nnnn)."""
    A, A4 = random_tensors(seed, 0.3, 0.1)
    F, F4 = random_tensors(seed + 1)
    G, _ = random_tensors(seed + 2, 0.2)
    _, T4 = random_tensors(seed + 3)
    skew = np.random.default_rng(seed).normal(size=(3, 3))
    W = 0.01 * (skew - skew.T)
    density, force = DirectionalFit(0.25 / np.pi, A, A4), DirectionalFit(0.01, F, F4)
    crowd = len(n) * weight * density.shape(n)  # the weight of a row represents the number of contacts
    found = directional_mean(n, crowd * force.at(n), density)
    np.testing.assert_allclose(found.second, F, atol=1e-11)
    np.testing.assert_allclose(found.fourth, F4, atol=1e-11)
    pull = n @ G + n @ W.T + np.einsum("jklq,mk,ml,mq->mj", T4, n, n, n)
    t = pull - np.einsum("mi,mi->m", pull, n)[:, None] * n
    found = tangential_mean(n, crowd[:, None] * t, density)
    np.testing.assert_allclose(found.second, G, atol=1e-11)
    np.testing.assert_allclose(found.skew, W, atol=1e-11)
    np.testing.assert_allclose(found.fourth, T4, atol=1e-11)
    np.testing.assert_allclose(found.at(n), t, atol=1e-11)


@settings(max_examples=40)
@given(drawn=contact_sets)
def test_tensors_are_traceless_and_independent_of_the_sign_of_normals(drawn):
    normal = drawn.contacts.normal
    found, turned = normal_density(normal, 4), normal_density(-normal, 4)
    if len(normal) == 0:
        assert np.isnan(found.second).all() and np.isnan(found.fourth).all()
        return
    np.testing.assert_array_equal(found.fourth, turned.fourth)
    assert abs(np.trace(found.second)) < 1e-12 * np.abs(found.second).max() + 1e-13
    assert np.abs(np.einsum("iikl->kl", found.fourth)).max() < 1e-12 * np.abs(found.fourth).max() + 1e-12
    np.testing.assert_allclose(found.fourth, found.fourth.transpose(3, 1, 0, 2), atol=1e-12)


def test_other_orders_are_refused():
    with pytest.raises(ValueError, match="order 3"):
        directional_fit(n, np.ones(len(n)), 3)


def test_bins_have_equal_solid_angles():
    rng = np.random.default_rng(1)
    v = rng.normal(size=(60_000, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    for bins, bin_of in ((10, polar_bins(v, 10)[1]), (48, hemisphere_bins(v, 4, 12))):
        counts = np.bincount(bin_of, minlength=bins)
        assert np.abs(counts / counts.mean() - 1).max() < 5 * np.sqrt(bins / len(v))
        np.testing.assert_array_equal(hemisphere_bins(v, 4, 12), hemisphere_bins(-v, 4, 12))
    assert np.isnan(bin_means(np.ones(2), np.array([0, 2]), 3)).tolist() == [False, True, False]
