import numpy as np
import pytest
from scipy.integrate import quad

from labkit.micro.void_ratio import lens_volume


@pytest.mark.parametrize(("a", "b", "delta"), [(1.0, 1.0, 0.1), (1.0, 0.7, 0.05), (1.2, 0.3, 0.4), (1.0, 0.5, 0.9)])
def test_the_lens_of_two_spheres_equals_the_integral_of_its_sections(a, b, delta):
    distance = a + b - delta

    def section(x):
        return np.pi * max(0.0, min(a**2 - x**2, b**2 - (x - distance) ** 2))

    kink = (distance**2 + a**2 - b**2) / (2 * distance)
    volume = quad(section, distance - b, kink)[0] + quad(section, kink, a)[0]
    assert np.isclose(lens_volume(a, b, delta), volume, rtol=1e-8)


def test_lens_is_zero_without_contact_and_the_whole_sphere_inside():
    assert lens_volume(1.0, 0.5, -0.1) == 0.0
    assert lens_volume(1.0, 0.5, 0.0) == 0.0
    assert np.isclose(lens_volume(1.0, 0.5, 1.2), 4 / 3 * np.pi * 0.125)
    assert np.isclose(lens_volume(1.0, 0.5, 1.0), 4 / 3 * np.pi * 0.125)
    assert lens_volume(np.ones(3), 0.5, np.array([-1.0, 0.1, 2.0])).shape == (3,)
