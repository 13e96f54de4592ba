import numpy as np

from labkit.grains.scene import Scene
from labkit.grains.state import grains_in_cell
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import (
    along_deviator,
    branch_force,
    deviatoric_stress,
    equivalent_stress,
    lode_angle,
    mean_stress,
    relative_error,
)
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from tests.contact_sets import snapshot_of


def simple_cubic(n=3, overlap=1e-6, radius=85e-6):
    """A State of n^3 equal grains on a simple cubic lattice, with all contacts."""
    spacing = 2 * radius - overlap
    site = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    state = grains_in_cell(Scene(), np.full(n**3, radius), site * spacing, np.eye(3) * n * spacing)
    number = {tuple(s): k for k, s in enumerate(site)}
    pairs, shifts = [], []
    for s in site:
        for axis in range(3):
            neighbour = s + np.eye(3, dtype=int)[axis]
            pairs.append((number[tuple(s)], number[tuple(neighbour % n)]))
            shifts.append(neighbour // n)
    zero = np.zeros((len(pairs), 3))
    return state.replace(
        contact_grain=np.array(pairs), contact_shift=np.array(shifts), tangential_force=zero, rolling_moment=zero
    )


def test_the_stress_of_a_simple_cubic_crystal_has_a_closed_form():
    overlap, radius = 1e-6, 85e-6
    state = simple_cubic(3, overlap, radius)
    snapshot = state.snapshot()
    spacing = 2 * radius - overlap
    force = np.pi / 2 * 0.15e9 * radius * overlap  # D* = R for equal grains
    stress = love_stress(snapshot)
    np.testing.assert_allclose(stress, force / spacing**2 * np.eye(3), rtol=1e-9, atol=1e-6)
    solid = 4 / 3 * np.pi * radius**3
    assert np.isclose(void_ratio_nominal(snapshot), spacing**3 / solid - 1, rtol=1e-12)
    cap = np.pi * (overlap / 2) ** 2 * (3 * radius - overlap / 2) / 3  # two of them make a lens
    lens_free = spacing**3 / (solid - 3 * 2 * cap) - 1
    assert np.isclose(void_ratio(snapshot), lens_free, rtol=1e-9)


def test_love_stress_equals_the_sum_over_both_sides_in_the_paper(random_contacts):
    snapshot = random_contacts(200)
    contacts, radius, volume = snapshot.contacts, snapshot.radius, 1e-9
    total = np.zeros((3, 3))
    for k in range(len(contacts)):
        a, b = contacts.grain[k]
        on_first = -contacts.normal_force[k] * contacts.normal[k] + contacts.tangential_force[k]
        total += np.outer((radius[a] - contacts.overlap[k] / 2) * contacts.normal[k], on_first)
        total += np.outer((radius[b] - contacts.overlap[k] / 2) * -contacts.normal[k], -on_first)
    np.testing.assert_allclose(love_stress(snapshot), -total / volume, rtol=1e-12)
    products = branch_force(contacts.branch(radius).T, contacts.force_on_first().T)
    np.testing.assert_allclose(love_stress(snapshot).ravel(), [-x.sum() / volume for x in products], rtol=1e-12)


def test_the_stress_is_zero_without_contacts():
    assert np.array_equal(love_stress(snapshot_of(np.ones(4))), np.zeros((3, 3)))


def test_p_and_q_of_a_triaxial_stress():
    stress = np.diag([1.0, 1.0, 4.0])
    assert mean_stress(stress) == 2.0
    assert deviatoric_stress(stress) == 3.0
    assert np.isclose(relative_error(stress * 1.01, stress), 0.01)
    assert np.isnan(relative_error(np.zeros((3, 3)), np.zeros((3, 3))))


def test_invariants_do_not_change_under_rotation_and_match_triaxial_states():
    compression, extension = np.diag([1.0, 1.0, 4.0]), np.diag([4.0, 4.0, 1.0])
    between = np.diag([1.0, 2.5, 4.0])  # b = 0.5
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    for stress, q, angle in ((compression, 3.0, 0.0), (extension, 3.0, 60.0), (between, 1.5 * np.sqrt(3.0), 30.0)):
        for turned in (stress, rotation @ stress @ rotation.T):
            np.testing.assert_allclose(equivalent_stress(turned), q, rtol=1e-12)
            np.testing.assert_allclose(lode_angle(turned), angle, atol=1e-5)
    assert np.isnan(lode_angle(np.eye(3)))
    shear = np.eye(3) + 0.2 * np.array([[0.0, 0, 1], [0, 0, 0], [1, 0, 0]])
    np.testing.assert_allclose(equivalent_stress(shear), 0.2 * np.sqrt(3.0))


def test_the_component_along_the_deviator_is_q_of_the_stress_itself():
    stress = np.array([np.diag([1.0, 1.0, 4.0]), [[2.0, 0.3, 0.4], [0.3, 1.0, 0.1], [0.4, 0.1, 1.5]]])
    np.testing.assert_allclose(along_deviator(stress, stress), equivalent_stress(stress), rtol=1e-12)
    tensor = np.diag([0.2, 0.4, -0.6])
    np.testing.assert_allclose(along_deviator(tensor, stress[0]), deviatoric_stress(tensor))
    parts = np.array([stress[1] * 0.3, stress[1] * 0.7])
    np.testing.assert_allclose(along_deviator(parts, stress[1]).sum(), equivalent_stress(stress[1]))
