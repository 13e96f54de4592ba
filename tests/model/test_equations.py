"""C1 to C5 against the scalar formulas of coaxial triaxial states, and properties of all states."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labkit.errors import InputError
from labkit.micro.tensors import to_six, to_tensor
from labkit.model.parameters import Model, Parameters
from labkit.model.state import ModelState
from labkit.model.stiffness import state_rate, stress_rate
from labkit.sff.c0 import c0_stress
from tests.model.random_states import AXIS, assert_same_rates, deviator, random_state, rotation, symmetric
from tests.model.scalar_formulas import scalar_rates

SEEDS = st.integers(0, 10_000)


@settings(max_examples=60)
@given(seed=SEEDS)
def test_a_coaxial_triaxial_state_follows_the_scalar_formulas(seed):
    rng = np.random.default_rng(seed)
    e, Z, Lam = rng.uniform(0.55, 0.755), rng.uniform(3, 6.5), rng.uniform(1e-4, 0.02)
    a, f, t = rng.uniform(-0.5, 0.9), rng.uniform(-0.9, 0.9), rng.uniform(-0.06, 0.06)
    axial, radial = rng.normal(size=2)
    state = ModelState(e, Z, Lam, a * AXIS, f * AXIS, t * AXIS)
    D = np.diag([radial, radial, axial])
    found = state_rate(Model(), state, D)
    expected = scalar_rates(e, Z, Lam, a, f, t, axial, radial)
    assert_same_rates(found, expected, state, D)
    for start, value in zip((3, 9, 15), expected[3:], strict=True):
        np.testing.assert_allclose(to_tensor(found[start : start + 6]), value * AXIS, rtol=1e-10, atol=1e-12)


@settings(max_examples=40)
@given(seed=SEEDS)
def test_objectivity(seed):
    """Rates and stress rates rotate with the state and the strain rate."""
    rng = np.random.default_rng(seed)
    state, D, Q = random_state(rng), symmetric(rng, 1.0), rotation(rng)
    plain, rotated = state_rate(Model(), state, D), state_rate(Model(), state.rotate(Q), Q @ D @ Q.T)
    assert_same_rates(rotated, plain, state, D)
    for k in (3, 9, 15):
        tensor = Q @ to_tensor(plain[k : k + 6]) @ Q.T
        np.testing.assert_allclose(to_tensor(rotated[k : k + 6]), tensor, atol=1e-12 * np.abs(tensor).max())
    stress = Q @ stress_rate(Model(), state, D) @ Q.T
    found = stress_rate(Model(), state.rotate(Q), Q @ D @ Q.T)
    np.testing.assert_allclose(found, stress, atol=1e-12 * np.abs(stress).max())
    sigma = Q @ state.stress() @ Q.T
    np.testing.assert_allclose(state.rotate(Q).stress(), sigma, atol=1e-12 * np.abs(sigma).max())


@settings(max_examples=20)
@given(seed=SEEDS)
def test_zero_strain_rate_gives_zero_rates_and_rates_scale_with_it(seed):
    rng = np.random.default_rng(seed)
    state, D = random_state(rng), symmetric(rng, 1.0)
    assert not state_rate(Model(), state, np.zeros((3, 3))).any()
    assert not stress_rate(Model(), state, np.zeros((3, 3))).any()
    found, expected = state_rate(Model(), state, 7 * D), 7 * state_rate(Model(), state, D)
    assert_same_rates(found, expected, state, 7 * D)
    for k in (3, 9, 15):
        tensor = expected[k : k + 6]
        np.testing.assert_allclose(found[k : k + 6], tensor, atol=1e-12 * np.abs(tensor).max())


@settings(max_examples=20)
@given(seed=SEEDS)
def test_tensors_stay_symmetric_and_deviatoric(seed):
    rng = np.random.default_rng(seed)
    found = state_rate(Model(), random_state(rng), symmetric(rng, 1.0))
    for k in (3, 9, 15):
        assert abs(found[k : k + 3].sum()) < 1e-12 * np.linalg.norm(found[k : k + 6])


@settings(max_examples=20)
@given(seed=SEEDS, sign=st.sampled_from([1.0, -1.0]))
def test_isotropic_strain_changes_no_tensor_and_gains_or_loses_contacts_and_forces(seed, sign):
    state = random_state(np.random.default_rng(seed))
    found = state_rate(Model(), state, sign * np.eye(3) / 3)
    assert not found[3:].any()
    assert np.isclose(found[0], -sign * (1 + state.e))
    assert sign * found[1] > 0 and sign * found[2] > 0


def test_eqs_31_and_32_by_hand():
    state = ModelState(0.66, 5.0, 0.01)
    compression, dilation = (state_rate(Model(), state, sign * np.eye(3) / 3) for sign in (1.0, -1.0))
    Zcom, slope = 4 + 7.2 * 0.1**0.7, -7.2 * 0.7 * 0.1**-0.3
    np.testing.assert_allclose(compression[1:3], [-np.exp(3 * (Zcom - 5)) * slope * 1.66, 0.098 * 1.66])
    np.testing.assert_allclose(dilation[1:3], [-0.3 / 0.01, -0.075 * 1.66])


@settings(max_examples=30)
@given(seed=SEEDS)
def test_the_stress_rate_is_the_derivative_of_c0(seed):
    rng = np.random.default_rng(seed)
    state, D = random_state(rng), symmetric(rng, 1.0)
    y, v = state.vector()[:21], state_rate(Model(), state, D)

    def stress(h):
        z = y + h * v
        return c0_stress(0.15e9, z[1], z[2], z[0], *(to_tensor(z[k : k + 6]) for k in (3, 9, 15)))

    h = 1e-6
    found, expected = stress_rate(Model(), state, D), (stress(h) - stress(-h)) / (2 * h)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@settings(max_examples=20)
@given(seed=SEEDS)
def test_compiled_c0_equals_c0_of_sff(seed):
    state = random_state(np.random.default_rng(seed))
    found = Model().stress(state.vector())
    np.testing.assert_allclose(found, state.stress(), atol=1e-13 * np.abs(found).max())


def test_six_numbers_preserve_the_inner_product():
    rng = np.random.default_rng(0)
    S, T = symmetric(rng, 2.0), deviator(rng, 1.0)
    assert np.isclose(to_six(S) @ to_six(T), np.tensordot(S, T))
    np.testing.assert_allclose(to_tensor(to_six(S)), S)


def test_the_stress_vanishes_without_contacts_or_forces():
    assert not ModelState(0.67, 0.0, 0.01).stress().any()
    assert not ModelState(0.67, 5.0, 0.0).stress().any()
    A = 0.3 * AXIS
    stress = ModelState(0.67, 5.0, 0.01, A, -A).stress()
    assert abs(stress[2, 2] - stress[0, 0]) < 0.03 * stress[0, 0]  # 2/5 A + 2/5 F = 0: isotropic to first order


@pytest.mark.parametrize("D", [np.arange(9.0).reshape(3, 3), np.full((3, 3), np.nan), np.zeros(3)])
def test_invalid_strain_rates(D):
    with pytest.raises(InputError, match="strain rate"):
        state_rate(Model(), ModelState(0.67, 5.0, 0.01), D)


@pytest.mark.parametrize(
    "change",
    [
        {"Z": -1.0},
        {"Lam": -1e-3},
        {"e": 0.0},
        {"e": np.nan},
        {"A": np.eye(3)},
        {"A": np.triu(np.ones((3, 3)), 1)},
        {"F": np.full((3, 3), np.inf)},
        {"Ft": np.zeros(6)},
        {"A": -1.5 * AXIS},
    ],
)
def test_impossible_states(change):
    with pytest.raises(InputError):
        ModelState(**{"e": 0.67, "Z": 5.0, "Lam": 0.01, **change})


@pytest.mark.parametrize("change", [{"c_M": -1.0}, {"e_cmax": np.nan}, {"A_c": 0.0}, {"c_eZ": "5"}])
def test_invalid_parameters(change):
    with pytest.raises(InputError, match=next(iter(change))):
        Parameters(**change)
