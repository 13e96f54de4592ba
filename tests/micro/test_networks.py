import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.micro.contact_sides import normalised_force, normalised_normal_force, vectors_of_contacts, vectors_of_sides
from labkit.micro.networks import follow, network_stress, strong_by_force, strong_by_normalised_force
from labkit.micro.snapshot import love_stress
from tests.contact_sets import E, contact_sets


@settings(max_examples=40)
@given(drawn=contact_sets, seed=st.integers(0, 1000))
def test_two_complementary_networks_add_up_to_love_stress(drawn, seed):
    side = np.random.default_rng(seed).random((len(drawn.contacts), 2)) < 0.5
    both = network_stress(drawn, side) + network_stress(drawn, ~side)
    love = love_stress(drawn)
    np.testing.assert_allclose(both, love, rtol=1e-12, atol=1e-12 * np.abs(love).max())


@settings(max_examples=40)
@given(drawn=contact_sets)
def test_normalised_force_follows_the_definition_below_eq_18(drawn):
    contacts, radius = drawn.contacts, drawn.radius
    found = normalised_force(drawn)
    for c in range(min(len(contacts), 5)):
        for side, sign in ((0, 1.0), (1, -1.0)):
            D = 2 * radius[contacts.grain[c, side]]
            force = sign * (contacts.tangential_force[c] - contacts.normal_force[c] * contacts.normal[c])
            expected = 3 * (1 - contacts.overlap[c] / D) * force / (np.pi * D**2)
            np.testing.assert_allclose(found[c, side], expected, rtol=1e-12, atol=1e-14 * np.abs(expected).max())
    Lambda_n = normalised_normal_force(drawn)
    outward = np.stack([contacts.normal, -contacts.normal], axis=1)
    np.testing.assert_allclose(Lambda_n, -np.einsum("csi,csi->cs", found, outward) / E, rtol=1e-10)
    whole = vectors_of_contacts(drawn)
    sides = vectors_of_sides(drawn, np.ones((len(contacts), 2), dtype=bool), 4.0 / 3.0 * np.pi * drawn.radius**3)
    assert len(sides) == 2 * len(whole)
    np.testing.assert_allclose(sides.normal_component.sum(), 2 * whole.normal_component.sum(), rtol=1e-12)


def test_strong_sides_are_those_above_the_mean(random_contacts):
    snapshot = random_contacts(200)
    contacts = snapshot.contacts
    by_force, by_normalised = strong_by_force(snapshot), strong_by_normalised_force(snapshot)
    Lambda_n = normalised_normal_force(snapshot)
    assert (Lambda_n[by_normalised] > Lambda_n.mean()).all() and (Lambda_n[~by_normalised] <= Lambda_n.mean()).all()
    np.testing.assert_array_equal(by_force[:, 0], contacts.normal_force > contacts.normal_force.mean())
    assert (by_normalised[:, 0] != by_normalised[:, 1]).any()  # the two sides of a contact may differ


def test_lives_of_a_small_example():
    snapshots = [[(0, 1), (1, 2)], [(2, 1), (2, 3)], [(2, 3), (0, 1)]]
    lives = follow([np.array(s) for s in snapshots], 4)
    assert lives.contacts.tolist() == [2, 2, 2]
    assert lives.gained.tolist() == [0, 1, 1] and lives.lost.tolist() == [0, 1, 1] and lives.kept.tolist() == [0, 1, 1]
    found = {
        (*pair, birth, death)
        for pair, birth, death in zip(lives.pair.tolist(), lives.birth, lives.death, strict=True)
        for pair in [tuple(pair)]
    }
    assert found == {(0, 1, 0, 1), (1, 2, 0, 2), (2, 3, 1, 3), (0, 1, 2, 3)}
    ages = lives.age_sum(np.array([0.0, 0.1, 0.3]))
    np.testing.assert_allclose(ages, [0.0, 0.1, 0.2], atol=1e-15)


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), snapshots=st.integers(0, 6), grains=st.integers(2, 8))
def test_lives_account_for_every_contact_of_every_snapshot(seed, snapshots, grains):
    rng = np.random.default_rng(seed)
    every = [(a, b) for a in range(grains) for b in range(a + 1, grains)]
    present = [[pair for pair in every if rng.random() < 0.4] for _ in range(snapshots)]
    lives = follow([np.array(pairs, dtype=int).reshape(-1, 2) for pairs in present], grains)
    for k, pairs in enumerate(present):
        alive = (lives.birth <= k) & (k < lives.death)
        assert sorted(map(tuple, lives.pair[alive].tolist())) == sorted(pairs)
        before = set(present[k - 1]) if k else set()
        assert lives.kept[k] == len(before & set(pairs)) and lives.lost[k] == len(before - set(pairs))
        times = np.arange(snapshots) ** 2.0
        assert np.isclose(lives.age_sum(times)[k], np.sum(times[k] - times[lives.birth[alive]]))
