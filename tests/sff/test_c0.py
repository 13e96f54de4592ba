import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import lebedev_rule

from labkit.sff.c0 import c0_stress, symmetric_product
from tests.model.random_states import deviator

E = 0.15e9


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_c0_is_the_integral_over_the_sphere_also_for_non_coaxial_tensors(seed):
    """Eq. 22: E Z/(1+e) times the integral of Lam (1 + n.F n) (1 + n.A n)/(4 pi) n n, plus the F^t term."""
    rng = np.random.default_rng(seed)
    A, F, Ft = deviator(rng, 0.5), deviator(rng, 0.9), deviator(rng, 0.05)
    n, weight = lebedev_rule(13)  # exact for the polynomials of degree 6 here
    function = (1 + np.einsum("ic,ij,jc->c", n, F, n)) * (1 + np.einsum("ic,ij,jc->c", n, A, n))
    integral = np.einsum("c,ic,jc->ij", weight * function, n, n) / (4 * np.pi)
    expected = E * 5.0 * 0.01 / 1.7 * (integral + Ft)
    np.testing.assert_allclose(c0_stress(E, 5.0, 0.01, 0.7, A, F, Ft), expected, rtol=1e-12, atol=1e-6)


def test_symmetric_product_of_non_coaxial_tensors_is_symmetric():
    rng = np.random.default_rng(0)
    F, A = deviator(rng, 1.0), deviator(rng, 1.0)
    assert np.abs(F @ A - (F @ A).T).max() > 0.05  # the paper's FA is not symmetric
    np.testing.assert_array_equal(symmetric_product(F, A), symmetric_product(F, A).T)
    assert np.isclose(np.trace(symmetric_product(F, A)), np.trace(F @ A))


def test_edge_cases_of_section_4():
    zero, nan = np.zeros((3, 3)), np.full((3, 3), np.nan)
    assert np.array_equal(c0_stress(E, 0.0, 0.01, 0.7, nan, nan, nan), zero)  # no contacts
    assert np.array_equal(c0_stress(E, 5.0, 0.0, 0.7, zero, nan, nan), zero)  # contacts without force
    assert np.array_equal(c0_stress(0.0, 5.0, 0.01, 0.7, zero, zero, zero), zero)
    assert np.array_equal(c0_stress(E, 5.0, 0.01, np.inf, zero, zero, zero), zero)
    np.testing.assert_allclose(c0_stress(E, 5.0, 0.01, 0.7, zero, zero, zero), E * 0.05 / 1.7 / 3 * np.eye(3))


def test_the_critical_state_of_the_paper_has_its_strength():
    """The linear terms (Eq. 30) give q/p = 0.93 with A_zz = 0.45, F_zz = 0.77, F^t_zz = 0.045."""
    axis = np.diag([-0.5, -0.5, 1.0])
    stress = c0_stress(E, 5.0, 0.01, 0.67, 0.45 * axis, 0.77 * axis, 0.045 * axis)
    linear = 1.5 * (0.4 * 0.45 + 0.4 * 0.77 + 3 * 0.045)
    assert np.isclose(linear, 0.93, atol=0.005)
    full = (stress[2, 2] - stress[0, 0]) / (np.trace(stress) / 3)
    assert np.isclose(full, linear, rtol=0.08)


def test_c0_accepts_arrays_of_states():
    rng = np.random.default_rng(1)
    A = np.stack([deviator(rng, 0.3) for _ in range(4)])
    both = c0_stress(E, np.full(4, 5.0), np.array([0.0, 0.01, 0.02, 0.03]), np.full(4, 0.7), A, A, A)
    assert both.shape == (4, 3, 3)
    np.testing.assert_array_equal(both[2], c0_stress(E, 5.0, 0.02, 0.7, A[2], A[2], A[2]))
    assert not both[0].any()
