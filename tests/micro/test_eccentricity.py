"""Eccentric contacts: M, X and G by hand and by sympy, the exact stress, objectivity."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import sympy

import labkit as lk
from labkit.micro.contact_sides import vectors_of_contacts
from labkit.micro.eccentricity import eccentric_dyads, normal_force_eccentricity, tangential_arms
from labkit.micro.snapshot import contact_arms
from labkit.sff.budget import error_budget
from labkit.sff.c0 import strength_shares

E = lk.Scene().young_modulus
SIDES = np.array([1.0, -1.0])


def contacts_of(normal, vectors, normal_force, tangential_force, grain) -> lk.Contacts:
    count = len(normal)
    return lk.Contacts(
        np.asarray(grain), normal, np.zeros(count), normal_force, tangential_force, np.zeros((count, 3)), vectors
    )


def clumps(rng: np.random.Generator, contacts: int = 400, grains: int = 60) -> lk.Snapshot:
    """A snapshot of grains of several sizes with random contact vectors and forces."""
    radius = rng.uniform(0.5e-3, 1.5e-3, grains)
    normal = rng.normal(size=(contacts, 3)) * [1.0, 1.0, 1.6]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    grain = np.array([rng.choice(grains, 2, replace=False) for _ in range(contacts)])
    outward = SIDES[:, None] * normal[:, None]
    vectors = radius[grain][..., None] * (outward + 0.4 * rng.normal(size=(contacts, 2, 3)))
    tangential = rng.normal(size=(contacts, 3))
    tangential -= np.einsum("ci,ci->c", tangential, normal)[:, None] * normal
    made = contacts_of(normal, vectors, rng.exponential(1.0, contacts), 0.3 * tangential, grain)
    return lk.Snapshot(lk.Scene(), radius, np.diag([0.02, 0.02, 0.03]), made)


def test_three_contacts_by_hand():
    """Three contacts along the axes; on the first grain one has a lever arm of its normal force, one of its shear."""
    radius, normal = np.array([1e-3, 1e-3]), np.eye(3)
    vectors = 1e-3 * np.stack([normal, -normal], axis=1)
    vectors[0, 0] += [0.0, 0.0, 2e-4]  # l_t along z where n is x
    vectors[1, 1] += [3e-4, 0.0, 0.0]  # on the second grain: l_t along x where its outward normal is -y
    tangential = np.zeros((3, 3))
    tangential[1] = [0.5, 0.0, 0.0]
    made = contacts_of(normal, vectors, np.array([4.0, 2.0, 1.0]), tangential, [[0, 1]] * 3)
    snapshot = lk.Snapshot(lk.Scene(), radius, 0.01 * np.eye(3), made)
    found = lk.statistics(snapshot)
    v, sides = 4.0 / 3.0 * np.pi * 1e-9, 6
    Lambda = (4.0 + 2.0 + 1.0) * 1e-3 * 2 / (v * E * sides)  # A = 0, and every l.n is 1 mm
    assert found.mean_normalised_force == pytest.approx(Lambda, rel=1e-12)
    M, X = np.zeros((3, 3)), np.zeros((3, 3))
    M[2, 0] = 4.0 * 2e-4  # f_n l_t (x) n
    M[0, 1] = -2.0 * 3e-4  # f_n l_t (x) (-y)
    X[0, 0] = 3e-4 * -0.5  # the shear force on the second grain is -0.5 N along x
    scale = 1.0 / (v * E * sides * Lambda)
    np.testing.assert_allclose(found.normal_force_eccentricity, M * scale, atol=1e-15)
    np.testing.assert_allclose(found.tangential_force_eccentricity, X * scale, atol=1e-15)
    G = np.zeros((3, 3))  # 5 sym <n (x) t>, t = (l_t/R)/<l_n/R>, both sides of three contacts
    G[0, 2] = G[2, 0] = 0.5 * 5.0 * 0.2 / sides
    G[0, 1] = G[1, 0] = -0.5 * 5.0 * 0.3 / sides
    np.testing.assert_allclose(found.contact_eccentricity, G, atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_without_truncation_the_expression_is_loves_stress(seed):
    snapshot = clumps(np.random.default_rng(seed))
    contacts, love = snapshot.contacts, lk.love_stress(snapshot)
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3
    n, f_n, f_t = contacts.normal, contacts.normal_force, contacts.tangential_force
    M, X = eccentric_dyads(snapshot)
    weight = volume[contacts.grain]  # every side with the volume of its own grain
    along = contact_arms(snapshot) / (weight * E)
    spheres = np.einsum("cs,c,ci,cj->csij", along, f_n, n, n) - np.einsum("cs,ci,cj->csij", along, n, f_t)
    exact = E / snapshot.volume * np.einsum("cs,csij->ij", weight, spheres + M - X)
    np.testing.assert_allclose(exact, love, rtol=0, atol=1e-12 * np.abs(love).max())
    budget = error_budget(snapshot)
    np.testing.assert_allclose(
        sum(budget.values()), lk.sff_stress(snapshot) - love, rtol=0, atol=1e-12 * np.abs(love).max()
    )
    assert np.abs(np.einsum("csi,ci->cs", tangential_arms(snapshot), n)).max() < 1e-15
    assert abs(np.trace(lk.statistics(snapshot).normal_force_eccentricity)) < 1e-14


def test_every_statistic_rotates_with_the_grains():
    snapshot = clumps(np.random.default_rng(5))
    Q, _ = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))
    Q = Q * np.sign(np.linalg.det(Q))
    contacts = snapshot.contacts
    turned = dataclasses.replace(
        contacts,
        normal=contacts.normal @ Q.T,
        vectors=contacts.vectors @ Q.T,
        tangential_force=contacts.tangential_force @ Q.T,
    )
    before, after = (
        lk.statistics(one) for one in (snapshot, dataclasses.replace(snapshot, contacts=turned, cell=Q @ snapshot.cell))
    )
    for name in ("contact_eccentricity", "normal_force_eccentricity", "tangential_force_eccentricity"):
        np.testing.assert_allclose(getattr(after, name), Q @ getattr(before, name) @ Q.T, atol=1e-13)


def test_spheres_have_no_eccentric_terms_and_clumps_without_contacts_have_nan():
    snapshot = clumps(np.random.default_rng(1))
    contacts = snapshot.contacts
    spheres = dataclasses.replace(snapshot, contacts=dataclasses.replace(contacts, vectors=None))
    assert lk.statistics(spheres).eccentricity is None
    assert vectors_of_contacts(spheres).eccentric is None
    assert not tangential_arms(spheres).any()
    reach = contact_arms(spheres)[:, :, None] * SIDES[:, None] * contacts.normal[:, None]
    same = dataclasses.replace(snapshot, contacts=dataclasses.replace(contacts, vectors=reach))
    np.testing.assert_allclose(lk.sff_stress(same), lk.sff_stress(spheres), rtol=1e-12, atol=1e-9)
    assert np.abs(lk.statistics(same).eccentricity).max() < 1e-15
    empty = dataclasses.replace(snapshot, contacts=contacts.take(np.zeros(0, int)))
    assert np.isnan(lk.statistics(empty).normal_force_eccentricity).all()
    assert not lk.sff_stress(empty).any()


def sphere_mean(expression, theta, phi):
    """The mean of an expression over the unit sphere."""
    inner = sympy.integrate(sympy.expand(expression * sympy.sin(theta)), (phi, 0, 2 * sympy.pi))
    return sympy.integrate(sympy.expand(inner), (theta, 0, sympy.pi)) / (4 * sympy.pi)


def test_the_closed_form_is_the_mean_over_the_sphere():
    """M for l_t(n) = G n - (n.G n) n and Lambda_n(n) p(n) = 1 + n.B n, for G and B that are not coaxial, by sympy."""
    theta, phi = sympy.symbols("theta phi", real=True)
    g, h, b, c = sympy.symbols("g h b c", real=True)
    n = sympy.Matrix([sympy.sin(theta) * sympy.cos(phi), sympy.sin(theta) * sympy.sin(phi), sympy.cos(theta)])
    G = sympy.Matrix([[-g, 0, h], [0, 0, 0], [h, 0, g]])
    B = sympy.Matrix([[b, c, 0], [c, b, 0], [0, 0, -2 * b]])
    t = G * n - (n.T * G * n)[0] * n
    weight = 1 + (n.T * B * n)[0]
    mean = sympy.Matrix(3, 3, lambda i, j: sphere_mean(t[i] * n[j] * weight, theta, phi))
    product = G * B
    closed = G / 5 + 2 * product / 15 - 4 * (product + product.T) / 105 - 2 * product.trace() * sympy.eye(3) / 105
    assert sympy.simplify(mean - closed) == sympy.zeros(3, 3)
    values = {g: 0.3, h: -0.2, b: 0.1, c: 0.4}
    numbers = [np.array(one.subs(values), float) for one in (G, B, closed)]
    np.testing.assert_allclose(normal_force_eccentricity(*numbers[:2]), numbers[2], atol=1e-15)


def test_the_shares_of_strength_add_up_with_the_eccentric_terms():
    snapshot = clumps(np.random.default_rng(3))
    found, stress = lk.statistics(snapshot), lk.sff_stress(snapshot)
    shares = strength_shares(
        found.contact_anisotropy,
        found.normal_force_anisotropy,
        found.mobilisation,
        eccentric=(found.normal_force_eccentricity, found.tangential_force_eccentricity),
    )
    assert set(shares) == {"A", "F", "Ft", "coupled", "M", "-X"}
    assert sum(shares.values()) == pytest.approx(lk.deviatoric_stress(stress) / lk.mean_stress(stress), rel=1e-12)


def test_the_third_order_of_the_closed_form_is_small():
    """The product of A and F adds 8 % of M at A_zz = 0.85 and F_zz = 0.8, by Gauss quadrature over the sphere."""
    axial = np.diag([-0.5, -0.5, 1.0])
    G, A, F = -0.07 * axial, 0.85 * axial, 0.8 * axial
    z, weight = np.polynomial.legendre.leggauss(20)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    z, weight = np.repeat(z, 40), np.repeat(weight, 40) / 80.0
    across = np.sqrt(1.0 - z**2)
    n = np.column_stack([across * np.cos(np.tile(azimuth, 20)), across * np.sin(np.tile(azimuth, 20)), z])
    lean, fabric, force = (np.einsum("mi,ij,mj->m", n, tensor, n) for tensor in (G, A, F))
    t = n @ G - lean[:, None] * n
    second, third = ((t * (weight * w)[:, None]).T @ n for w in (1.0 + fabric + force, fabric * force))
    np.testing.assert_allclose(second, normal_force_eccentricity(G, A + F), atol=1e-15)
    assert third[2, 2] / second[2, 2] == pytest.approx(0.079, abs=0.001)
