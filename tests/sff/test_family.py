"""Stress-force-fabric equations: integrals, limiting cases and error budgets that hold exactly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import lebedev_rule

from labkit.errors import InputError
from labkit.micro.fabric import DirectionalFit, TangentialFit, statistics
from labkit.micro.snapshot import Contacts, love_stress
from labkit.micro.stress import relative_error
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.sff.budget import PARTS, error_budget, standard_errors
from labkit.sff.c0 import c0_stress, sff_stress, strength_shares
from labkit.sff.family import FORMS, product_integral, stress, tangential_coupling
from tests.contact_sets import E, contact_sets, make, snapshot_of
from tests.micro.test_directions import random_tensors

n_, w_ = lebedev_rule(17)
n, weight = n_.T, w_ / (4 * np.pi)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_the_product_of_two_fourth_order_functions_is_integrated_exactly(seed):
    A, A4 = random_tensors(seed)
    F, F4 = random_tensors(seed + 1)
    function = DirectionalFit(1.0, A, A4).at(n) * DirectionalFit(1.0, F, F4).at(n)
    expected = np.einsum("m,mi,mj->ij", weight * function, n, n)
    np.testing.assert_allclose(product_integral(A, F, A4, F4), expected, atol=1e-13)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_the_coupling_of_tangential_forces_and_normals_is_integrated_exactly(seed):
    A, A4 = random_tensors(seed)
    Ft = np.random.default_rng(seed).normal(size=(3, 3)) * 0.05
    Ft -= np.trace(Ft) / 3 * np.eye(3)
    t = TangentialFit(2.5 * (Ft + Ft.T), 1.5 * (Ft.T - Ft), np.zeros((3, 3, 3, 3))).at(n)
    np.testing.assert_allclose(np.einsum("m,mi,mj->ij", weight, n, t), Ft, atol=1e-13)  # t belongs to F^t
    anisotropic = weight * (DirectionalFit(1.0, A, A4).at(n) - 1.0)
    expected = np.einsum("m,mi,mj->ij", anisotropic, n, t)
    np.testing.assert_allclose(tangential_coupling(A, Ft, A4), expected, atol=1e-13)


@settings(max_examples=40)
@given(drawn=contact_sets)
def test_the_form_c0_equals_the_recorded_c0_stress(drawn):
    found = statistics(drawn)
    expected = c0_stress(
        E,
        found.coordination_number,
        found.mean_normalised_force,
        void_ratio_nominal(drawn),
        found.contact_anisotropy,
        found.normal_force_anisotropy,
        found.mobilisation,
    )
    np.testing.assert_array_equal(sff_stress(drawn), expected)
    same(stress("c0", drawn), expected)


@settings(max_examples=40)
@given(drawn=contact_sets)
def test_a_single_group_changes_nothing(drawn):
    """With one group, Eqs. 16 and 17 reduce to Eq. 12 and to C0 with the mean grain volume."""
    one = np.zeros(drawn.number_of_grains, dtype=int)
    for grouped, whole in (("classical_groups", "classical"), ("c0_groups", "c0_volume")):
        same(stress(grouped, drawn, one), stress(whole, drawn))


def same(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())


def on_the_sphere(A, F, G, order4=None):
    """A Snapshot of equal grains with known directional functions; each point of the quadrature is repeated."""
    A4, F4 = order4 or (np.zeros((3, 3, 3, 3)),) * 2
    copies = np.maximum(1, np.round(4000 * weight * DirectionalFit(1.0, A, A4).at(n) / weight.max() / 4)).astype(int)
    normal = np.repeat(n, copies, axis=0)
    fn = DirectionalFit(1e-3, F, F4).at(normal)
    pull = normal @ G
    ft = -1e-3 * (pull - np.einsum("mi,mi->m", pull, normal)[:, None] * normal)
    count = len(normal)
    pair = np.tile([[0, 1]], (count, 1))
    contacts = Contacts(pair, normal, np.full(count, 1e-9), fn, ft, np.zeros((count, 3)))
    return snapshot_of(np.full(10, 1e-4), contacts, 1e-10)


def test_each_form_is_exact_where_its_assumption_holds():
    """Grains of one size: `c0_tangential` is exact for second-order functions, `fourth` for fourth-order functions."""
    A, A4 = random_tensors(1, 0.3, 0.1)
    F, F4 = random_tensors(2, 0.6, 0.2)
    G, _ = random_tensors(3, 0.3)
    for order4, exact, worse in ((None, "c0_tangential", "c0"), ((A4, F4), "fourth", "c0_tangential")):
        snapshot = on_the_sphere(A, F, G, order4)
        love = love_stress(snapshot)
        errors = {form: relative_error(stress(form, snapshot), love) for form in FORMS}
        assert errors[exact] < 2e-3 and errors[worse] > 3 * errors[exact], errors


def test_eq_12_has_the_magnitude_of_love_stress_if_both_sides_are_counted():
    """For isotropic contacts of equal grains, the printed 3V would give twice Love's stress."""
    zero = np.zeros((3, 3))
    snapshot = on_the_sphere(zero, zero, zero)
    assert relative_error(stress("classical", snapshot), love_stress(snapshot)) < 2e-3


def test_eqs_28_to_30_neglect_the_product():
    A, F, Ft = np.diag([-0.2, -0.25, 0.45]), np.diag([-0.4, -0.37, 0.77]), np.diag([-0.02, -0.025, 0.045])
    snapshot = on_the_sphere(A, F, 5 * Ft)
    found = stress("linear", snapshot)
    fabric = statistics(snapshot)
    p = np.trace(found) / 3
    e = void_ratio_nominal(snapshot)
    assert np.isclose(p, E * fabric.coordination_number * fabric.mean_normalised_force / 3 / (1 + e), rtol=1e-12)
    ratio = 0.4 * fabric.contact_anisotropy + 0.4 * fabric.normal_force_anisotropy + 3 * fabric.mobilisation
    np.testing.assert_allclose(found / p - np.eye(3), ratio, atol=1e-12)


@settings(max_examples=60)
@given(drawn=contact_sets, e=st.sampled_from(["nominal", "reported"]), with_lambda=st.booleans())
def test_the_contributions_add_up_to_the_error(drawn, e, with_lambda):
    parts = error_budget(drawn, e, with_lambda)
    assert list(parts) == list(PARTS)
    love = love_stress(drawn)
    c0 = stress("c0", drawn)
    if e == "reported" and len(drawn.contacts):
        c0 = c0 * (1 + void_ratio_nominal(drawn)) / (1 + void_ratio(drawn))
    size = max((np.abs(part).max() for part in parts.values()), default=0.0) + np.abs(love).max()
    if with_lambda:
        assert np.abs(sum(parts.values()) - (c0 - love)).max() <= 1e-12 * size
    assert np.abs(parts["overlap_correction"]).max() == 0.0 or not with_lambda
    assert np.abs(parts["grain_volume"]).max() == 0.0 or e == "reported"


def test_the_budget_attributes_a_known_error():
    """For equal grains and known functions, the error is due to truncation only; for two sizes, to unequal stress."""
    A, A4 = random_tensors(1, 0.3, 0.1)
    F, _ = random_tensors(2, 0.6, 0.2)
    zero, zero4 = np.zeros((3, 3)), np.zeros((3, 3, 3, 3))
    parts = {k: np.linalg.norm(v) for k, v in error_budget(on_the_sphere(A, F, zero, (A4, zero4))).items()}
    assert parts["normals"] > 5 * max(parts[k] for k in PARTS if k not in ("normals", "normal_forces"))
    assert parts["equal_stress"] < 1e-8 * parts["normals"]
    contacts_size = on_the_sphere(zero, zero, zero).contacts
    small = Contacts(
        np.where(np.arange(len(contacts_size))[:, None] % 3 == 0, [[0, 1]], [[2, 3]]),
        contacts_size.normal,
        contacts_size.overlap,
        contacts_size.normal_force,
        contacts_size.tangential_force,
        contacts_size.rolling_moment,
    )
    radius = np.where(np.arange(10) < 2, 1e-4, 2e-4)
    parts = {k: np.linalg.norm(v) for k, v in error_budget(snapshot_of(radius, small, 1e-9)).items()}
    assert parts["equal_stress"] > 100 * max(v for k, v in parts.items() if k != "equal_stress")


def test_standard_errors_shrink_with_the_number_of_contacts():
    drawn = [make(5, contacts, 200, 1.5, 0.2) for contacts in (1500, 24_000)]
    few, many = (
        np.linalg.norm(standard_errors(d, samples=40)["equal_stress"]) / np.linalg.norm(love_stress(d)) for d in drawn
    )
    assert 2.0 < few / many < 8.0  # a sixteenth of the contacts: four times the scatter


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_shares_of_the_strength_add_up_to_c0(seed):
    A, _ = random_tensors(seed, 0.5)
    F, _ = random_tensors(seed + 1, 0.9)
    Ft, _ = random_tensors(seed + 2, 0.05)
    s = c0_stress(E, 5.0, 0.01, 0.7, A, F, Ft)
    q_over_p = (s[2, 2] - 0.5 * (s[0, 0] + s[1, 1])) / (np.trace(s) / 3)
    assert np.isclose(sum(strength_shares(A, F, Ft).values()), q_over_p, rtol=1e-12, atol=1e-13)


def test_an_unknown_form_is_refused():
    drawn = make(1, 3, 5, 1.5, 0.0)
    with pytest.raises(InputError, match="c0_tangential"):
        stress("c1", drawn)
