"""Eqs. 13-18: the stresses of any groups add up to Love's stress."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.errors import InputError
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.snapshot import love_stress
from tests.contact_sets import contact_sets, make, snapshot_of


@settings(max_examples=80)
@given(drawn=contact_sets, groups=st.integers(1, 12), seed=st.integers(0, 1000), by_size=st.booleans())
def test_both_sums_equal_love_stress(drawn, groups, seed, by_size):
    if by_size:
        group = groups_by_diameter(drawn, diameter_edges(drawn, groups))
    else:  # any partition, including empty groups
        group = np.random.default_rng(seed).integers(0, groups, drawn.number_of_grains)
    love = love_stress(drawn)
    found = group_stresses(drawn, group, groups)
    size = np.abs(love).max()
    np.testing.assert_allclose(found.sum_by_contacts(), love, rtol=1e-12, atol=1e-12 * size)
    np.testing.assert_allclose(found.sum_by_volume(), love, rtol=1e-12, atol=1e-12 * size)
    assert np.isclose(found.volume_fraction.sum(), 1.0, rtol=1e-12)
    if len(drawn.contacts):
        assert np.isclose(found.by_contacts.sum(), 1.0, rtol=1e-12)
    assert np.isnan(found.per_volume[found.contacts == 0]).all()
    assert np.isfinite(found.per_volume[found.contacts > 0]).all()


def test_eq_18_as_printed_holds_for_grains_of_one_size():
    """-Z/(1+e) 1/N_c(k) sum of n (x) 3 lambda'/(pi D^2) f for a group of one diameter."""
    drawn = make(3, 60, 12, 1.0, 0.3)
    contacts, radius, volume = drawn.contacts, drawn.radius, drawn.volume
    group = np.arange(12) % 3
    found = group_stresses(drawn, group, 3)
    Z, e = 2 * 60 / 12, volume / np.sum(4 / 3 * np.pi * radius**3) - 1
    for k in range(3):
        total, sides = np.zeros((3, 3)), 0
        for c in range(60):
            force = -contacts.normal_force[c] * contacts.normal[c] + contacts.tangential_force[c]
            for side, sign in ((0, 1), (1, -1)):
                if group[contacts.grain[c, side]] == k:
                    D = 2 * radius[contacts.grain[c, side]]
                    total += (
                        np.outer(sign * contacts.normal[c], sign * force)
                        * 3
                        * (1 - contacts.overlap[c] / D)
                        / (np.pi * D**2)
                    )
                    sides += 1
        np.testing.assert_allclose(found.per_volume[k], -Z / (1 + e) / sides * total, rtol=1e-12)
        assert found.contacts[k] == sides


def test_the_largest_grain_is_in_the_last_group():
    grains = snapshot_of(np.linspace(1.0, 2.0, 11))
    assert np.bincount(groups_by_diameter(grains, diameter_edges(grains, 5))).tolist() == [2, 2, 2, 2, 3]


@pytest.mark.parametrize(
    ("edges", "message"), [([1.0], "ascending"), ([3.0, 1.0], "ascending"), ([1.0, 2.5], "outside the size groups")]
)
def test_invalid_edges_are_refused(edges, message):
    with pytest.raises(InputError, match=message):
        groups_by_diameter(snapshot_of([0.6, 1.4]), edges)


@pytest.fixture
def snapshot():
    return make(3, 60, 12, 2.0, 0.3)


@pytest.mark.parametrize("groups", [-5, 0, 2.5, "x", None, math.nan, 10**9])
def test_a_number_of_groups_that_is_none_is_refused(snapshot, groups):
    with pytest.raises(InputError) as refused:
        diameter_edges(snapshot, groups)
    assert refused.value.field == "groups"


@pytest.mark.parametrize("edges", ["x", 5, [[1.0, 2.0]], [1.0, math.nan], [1.0]])
def test_edges_that_are_none_are_refused(snapshot, edges):
    with pytest.raises(InputError, match="must be ascending"):
        groups_by_diameter(snapshot, edges)


@pytest.mark.parametrize("change", [lambda g: g + 5, lambda g: g - 1, lambda g: g[1:], lambda g: 1.0 * g])
def test_groups_that_do_not_fit_the_grains_are_refused(snapshot, change):
    group = groups_by_diameter(snapshot, diameter_edges(snapshot, 5))
    with pytest.raises(InputError) as refused:
        group_stresses(snapshot, change(group), 5)
    assert refused.value.field == "group"
