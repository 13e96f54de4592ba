"""The scalar strains that suit the paths."""

import numpy as np
import pytest

from labkit.paths.strain_measures import AXIAL, NORM, PURE_SHEAR, SHEAR, VOLUMETRIC
from labkit.records.instant import logarithmic_strain


def sheared(displacement, height=1.0):
    """Logarithmic strain of a unit cell whose top moved by `displacement` in -x, at this height."""
    return logarithmic_strain(np.array([[1.0, 0.0, -displacement], [0.0, 1.0, 0.0], [0.0, 0.0, height]]), np.eye(3))


@pytest.mark.parametrize("gamma", [0.0, 1e-3, -0.3, 2.0])
@pytest.mark.parametrize("height", [1.0, 0.9])
def test_the_shear_strain_is_displacement_over_height_at_any_size(gamma, height):
    assert SHEAR.at(sheared(gamma * height, height)) == pytest.approx(gamma, abs=1e-12)


def test_pure_shear_adds_up_to_the_integral_of_its_rate():
    gamma = 0.8
    principal = np.array([[np.cosh(gamma / 2), 0.0, -np.sinh(gamma / 2)], [0.0, 1.0, 0.0]])
    cell = np.vstack([principal, [-np.sinh(gamma / 2), 0.0, np.cosh(gamma / 2)]])
    assert PURE_SHEAR.at(logarithmic_strain(cell, np.eye(3))) == pytest.approx(gamma)


def test_axial_volumetric_and_norm():
    strain = np.array([np.diag([0.1, 0.2, k]) for k in (0.0, 0.02, 0.01)])
    np.testing.assert_allclose(AXIAL.at(strain), [0.0, 0.02, 0.01])
    np.testing.assert_allclose(VOLUMETRIC.at(strain), [0.3, 0.32, 0.31])
    np.testing.assert_allclose(AXIAL.accumulate(strain), [0.0, 0.02, 0.03])
    np.testing.assert_allclose(NORM.accumulate(strain), [0.0, 0.02, 0.03])
    assert list(AXIAL.reversals(strain)) == [1] and len(NORM.reversals(strain)) == 0


def test_noise_is_no_reversal():
    strain = np.zeros((50, 3, 3))
    strain[:, 2, 2] = np.linspace(0.0, 0.01, 50) + np.tile([0.0, 1e-9], 25)
    strain[20:30, 2, 2] = strain[20, 2, 2] + np.tile([0.0, 1e-8], 5)
    assert len(AXIAL.reversals(strain)) == 0
