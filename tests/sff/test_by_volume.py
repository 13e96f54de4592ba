"""The equation by volume: the proof that its mean stress is exact, and what its deviator neglects."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from hypothesis import given, settings

import labkit as lk
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.sff.family import stress, tangential_coupling
from labkit.sff.neglected import NEGLECTED, neglected_terms
from tests.contact_sets import contact_sets, make
from tests.micro.test_directions import random_tensors
from tests.micro.test_eccentricity import clumps
from tests.sff.test_family import on_the_sphere


def test_proof_that_the_second_order_fit_keeps_the_trace():
    """For any contacts, forces, A and F: <Lambda_n> = Lambda tr[bracket of C0], with Lambda, F of Eqs. 24 and 25.

    Written in g = Lambda_n/(1 + n.A n), both sides are polynomials in g, A and the unit vectors n of the contacts.
    """
    count = 3
    a, b, c, d, e = sympy.symbols("a b c d e")
    A = sympy.Matrix([[a, c, d], [c, b, e], [d, e, -a - b]])  # A is symmetric and has no trace; nothing else is used
    g = sympy.symbols(f"g:{count}")
    normals = [sympy.Matrix(sympy.symbols(f"x{k} y{k} z{k}")) for k in range(count)]
    Lambda_n = [g[k] * (1 + (n.T * A * n)[0]) for k, n in enumerate(normals)]
    Lam = sum(g) / sympy.Integer(count)
    moment = sum((g[k] * n * n.T for k, n in enumerate(normals)), sympy.zeros(3)) / count
    Lam_F = sympy.Rational(15, 2) * (moment - Lam * sympy.eye(3) / 3)  # Lambda F
    product = (Lam_F * A + A * Lam_F) / 2
    bracket = Lam * sympy.eye(3) / 3 + sympy.Rational(2, 15) * (Lam * A + Lam_F)
    bracket += sympy.Rational(2, 105) * product.trace() * sympy.eye(3) + sympy.Rational(8, 105) * product
    difference = sympy.expand(sum(Lambda_n) / sympy.Integer(count) - bracket.trace())
    assert difference != 0  # before the normals are unit vectors
    for x, y, z in normals:
        difference = sympy.expand(difference).subs(z**2, 1 - x**2 - y**2)
    assert sympy.expand(difference) == 0


@settings(max_examples=60)
@given(drawn=contact_sets)
def test_equation_and_neglected_terms_add_up_to_love(drawn):
    require_exact(drawn)


@pytest.mark.parametrize("seed", range(5))
def test_also_for_eccentric_contacts(seed):
    require_exact(clumps(np.random.default_rng(seed)))


def require_exact(snapshot):
    """p of Love's stress; no term has a trace; the sum is Love's stress. Rounding is that of the largest term."""
    love, by_volume, terms = lk.love_stress(snapshot), lk.sff_stress_by_volume(snapshot), neglected_terms(snapshot)
    assert set(terms) == set(NEGLECTED)
    size = 1e-11 * max(np.abs(one).max() for one in (love, by_volume, *terms.values()))
    assert np.trace(by_volume) == pytest.approx(np.trace(love), abs=3 * size, rel=1e-12)
    assert all(abs(np.trace(term)) <= 3 * size for term in terms.values())
    np.testing.assert_allclose(by_volume + sum(terms.values()), love, rtol=0, atol=size)


def test_the_terms_of_known_directional_functions():
    """Normals of second order, Lambda_n of fourth and Lambda_t of second order on a quadrature of the sphere."""
    A, F, F4 = random_tensors(1, 0.6)[0], *random_tensors(2, 0.3, 0.6)
    G, zero4 = random_tensors(3, 0.3)[0], np.zeros((3, 3, 3, 3))
    snapshot = on_the_sphere(A, F, G, (zero4, F4))
    fabric, terms = lk.micro.statistics_by_volume(snapshot), neglected_terms(snapshot)
    scale = snapshot.young_modulus * fabric.coordination_number / (1.0 + void_ratio_nominal(snapshot))
    scale *= fabric.mean_normalised_force
    size = 2e-3 * lk.love_stress(snapshot).max()
    np.testing.assert_allclose(terms["normal_4"], scale * 8 / 315 * np.einsum("ijkl,kl->ij", F4, A), atol=size)
    np.testing.assert_allclose(terms["tangential_2"], scale * tangential_coupling(A, G / 5), atol=size)
    assert np.abs(terms["tangential_4"]).max() < size < 0.3 * np.abs(terms["normal_4"]).max()


def test_equal_grains_have_one_equation():
    equal = make(1, 300, 40, 1.0, 0.5)
    np.testing.assert_allclose(lk.sff_stress_by_volume(equal), lk.sff_stress(equal), rtol=1e-12)
    np.testing.assert_allclose(
        lk.micro.statistics_by_volume(equal).mean_normalised_force,
        lk.statistics(equal).mean_normalised_force,
        rtol=1e-12,
    )


def test_lambda_by_hand_for_two_sizes():
    """One contact between grains of radius 1 and 3 mm: Lambda has each grain's volume, or the mean."""
    none = np.zeros((1, 3))
    contact = lk.Contacts(np.array([[0, 1]]), np.array([[0.0, 0.0, 1.0]]), np.zeros(1), np.array([2.0]), none, none)
    snapshot = lk.Snapshot(lk.Scene(), np.array([1e-3, 3e-3]), 0.01 * np.eye(3), contact)
    E, shape = snapshot.young_modulus, 1.0 + 15 / 2 * (1 - 1 / 3)  # 1 + n.A n of a single direction
    volumes = 4 / 3 * np.pi * np.array([1e-9, 27e-9])
    arms = np.array([1e-3, 3e-3])
    printed, by_volume = lk.statistics(snapshot), lk.micro.statistics_by_volume(snapshot)
    assert printed.mean_normalised_force == pytest.approx(2.0 * (arms / volumes).mean() / E / shape)
    assert by_volume.mean_normalised_force == pytest.approx(2.0 * arms.mean() / volumes.mean() / E / shape)
    assert np.trace(lk.sff_stress_by_volume(snapshot)) == pytest.approx(2.0 * arms.sum() / 1e-6)  # f (R1 + R2)/V


def test_the_form_c0_volume_is_the_equation_by_volume():
    drawn = make(5, 300, 40, 5.0, 0.5)
    np.testing.assert_allclose(stress("c0_volume", drawn), lk.sff_stress_by_volume(drawn), rtol=1e-10)
