import numpy as np

from labkit.micro import indicators
from labkit.micro.snapshot import Contacts, contacts_per_grain
from tests.contact_sets import snapshot_of


def test_inertial_number_uses_the_euclidean_norm():
    rate = np.diag([-5.0, -5.0, 10.0])
    expected = np.sqrt(150.0) * 0.17e-3 * np.sqrt(2650 / 1e5)
    assert np.isclose(indicators.inertial_number(rate, 1e5, 0.17e-3, 2650), expected)
    assert indicators.inertial_number(rate, 0.0, 0.17e-3, 2650) == np.inf
    assert indicators.inertial_number(0 * rate, 0.0, 0.17e-3, 2650) == 0.0


def test_overlap_rattlers_and_unbalanced_force_of_a_chain():
    """Three grains in a row, the middle one in equilibrium, and a fourth without contacts."""
    radius = np.array([1.0, 2.0, 1.0, 1.0])
    contacts = Contacts(
        np.array([[0, 1], [1, 2]]),
        np.array([[1.0, 0, 0], [1.0, 0, 0]]),
        np.array([0.1, 0.1]),
        np.array([3.0, 3.0]),
        np.zeros((2, 3)),
        np.zeros((2, 3)),
    )
    chain = snapshot_of(radius, contacts)
    assert contacts_per_grain(chain).tolist() == [1, 2, 1, 0]
    assert np.isclose(indicators.overlap_ratio(chain), np.mean([0.05, 0.025, 0.025, 0.05]))
    assert indicators.rattler_fraction(chain) == 0.75
    np.testing.assert_allclose(indicators.resultant_forces(chain)[:, 0], [-3.0, 0.0, 3.0, 0.0])
    assert np.isclose(indicators.unbalanced_force(chain), (6.0 / 4) / 3.0)


def test_grains_without_contacts():
    apart = snapshot_of(np.ones(3))
    assert indicators.overlap_ratio(apart) == 0.0
    assert indicators.rattler_fraction(apart) == 1.0
    assert indicators.unbalanced_force(apart) == 0.0
    assert indicators.elastic_energy(apart) == 0.0
