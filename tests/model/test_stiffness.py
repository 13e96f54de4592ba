"""Stiffness: finite differences, homogeneity, the hypoplastic form; and the finite-element interface."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labkit.errors import InputError, PhysicsError
from labkit.micro.tensors import to_six, to_tensor
from labkit.model.controls import strain_control
from labkit.model.integrators import Adaptive, Problem
from labkit.model.parameters import MEASURED_REVERSALS, DensityDependence, LodeDependence, Model
from labkit.model.state import ModelState, isotropic_state
from labkit.model.stiffness import hypoplastic_form, rate_tangent, stress_rate
from labkit.plugins.umat.material_point import states, update
from tests.model.random_states import AXIS, random_state, rotation, symmetric

SEEDS = st.integers(0, 10_000)
LODE = LodeDependence(A_b=-0.05, A_w=0.04, F_b=0.06, F_w=0.1, Ft_b=0.1, Ft_w=0.07, d_e=0.02)
DENSE = DensityDependence(A_Z=-0.27, Ft_Z=0.39, F_d=0.49, Ft_d=0.18)
MODELS = (
    Model(),
    Model(c_dLam=5.0).reading(force_rate="distance", line_void_ratio="reported"),
    Model(c_dLam=5.0, lode=LODE).reading(line_void_ratio="reported"),
    Model(c_dLam=5.0, lode=LODE, density=DENSE).reading(compression="parallel"),
    Model(reversals=MEASURED_REVERSALS),
)


@settings(max_examples=40)
@given(seed=SEEDS, e=st.sampled_from([0.62, 0.70, 0.78]), model=st.sampled_from(MODELS))
def test_rate_tangent_against_finite_differences(seed, e, model):
    rng = np.random.default_rng(seed)
    model = model.reading(beyond_e_cmax="flat")
    state, D = random_state(rng, e), symmetric(rng, 1.0)
    tangent, h = rate_tangent(model, state, D), 1e-6
    assume(abs(np.trace(D)) > 10 * h)  # the branches of Eqs. 31 and 32 meet there
    for k in range(6):
        step = to_tensor(h * np.eye(6)[k])
        difference = to_six(stress_rate(model, state, D + step) - stress_rate(model, state, D - step)) / (2 * h)
        np.testing.assert_allclose(tangent[:, k], difference, atol=1e-6 * np.abs(tangent).max())
    np.testing.assert_allclose(tangent @ to_six(D), to_six(stress_rate(model, state, D)), atol=1e-10 * tangent.max())


@settings(max_examples=20)
@given(seed=SEEDS, size=st.sampled_from([1e-5, 1e-4, 1e-3, 1e-2]), model=st.sampled_from(MODELS))
def test_consistent_tangent_against_finite_differences(seed, size, model):
    """The tangent is the derivative of the substeps, compared where the increment is taken in a single substep."""
    rng = np.random.default_rng(seed)
    y, d = random_state(rng).vector()[None, :21], to_six(symmetric(rng, size))[None]
    found = update(model, y, d, tolerance=1.0)
    h = 1e-5 * size
    assume(abs(d[0, :3].sum()) > 10 * h)
    shifted = np.concatenate([d + h * np.eye(6), d - h * np.eye(6)])
    moved = update(model, np.tile(y, (12, 1)), shifted, tangent=False, tolerance=1.0)
    if found.status[0] or moved.status.any():  # a large increment can reduce Lambda to zero and fail
        assert size > 1e-3 and (not found.status[0] or np.isnan(found.tangent).all())
        return
    if found.substeps[0] == 1 and (moved.substeps == 1).all():
        difference = (moved.stress[:6] - moved.stress[6:]).T / (2 * h)
        np.testing.assert_allclose(found.tangent[0], difference, atol=1e-5 * np.abs(difference).max())
    else:
        assert size > 1e-4


@settings(max_examples=15)
@given(seed=SEEDS)
def test_the_consistent_tangent_of_many_substeps(seed):
    """With error control the tangent agrees with that of the exact solution within the tolerance."""
    rng = np.random.default_rng(seed)
    state, d = random_state(rng), to_six(symmetric(rng, 1e-3))
    found = update(Model(), state.vector()[None, :21], d[None], tolerance=1e-8).require()
    assert found.substeps[0] > 3
    h = 1e-3 * 1e-3
    assume(abs(d[:3].sum()) > 10 * h)

    def stress(strain):
        problem = Problem(Model(), strain_control(to_tensor(strain)))
        return to_six(problem.stress(Adaptive(1e-11).advance(problem, state.vector(), 1.0)))

    difference = np.stack([(stress(d + h * e) - stress(d - h * e)) / (2 * h) for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(found.tangent[0], difference, atol=1e-3 * np.abs(difference).max())


@settings(max_examples=20)
@given(seed=SEEDS)
def test_a_point_agrees_with_the_driver_and_rotates_with_its_axes(seed):
    rng = np.random.default_rng(seed)
    state, d, Q = random_state(rng), symmetric(rng, 1e-3), rotation(rng)
    found = update(Model(), state.vector()[None, :21], to_six(d)[None], tolerance=1e-7).require()
    problem = Problem(Model(), strain_control(d))
    exact = Adaptive(1e-11).advance(problem, state.vector(), 1.0)
    np.testing.assert_allclose(to_tensor(found.stress[0]), problem.stress(exact), atol=1e-4 * 1e6)
    rotated = update(Model(), state.rotate(Q).vector()[None, :21], to_six(Q @ d @ Q.T)[None], tolerance=1.0).require()
    plain = update(Model(), state.vector()[None, :21], to_six(d)[None], tolerance=1.0).require()
    if rotated.substeps[0] == plain.substeps[0] == 1:
        expected = Q @ to_tensor(plain.stress[0]) @ Q.T
        np.testing.assert_allclose(to_tensor(rotated.stress[0]), expected, atol=1e-12 * np.abs(expected).max())


def test_eq_34_is_exact_without_the_exponents_and_close_with_them(model):
    rng = np.random.default_rng(3)
    plain = model.with_parameters(gamma_A=0.0, gamma_F=0.0, c_Z=0.0)
    D = np.stack([symmetric(rng, 1.0) for _ in range(200)])
    for _ in range(5):
        state = random_state(rng)
        for compressing in (True, False):
            branch = D[(np.trace(D, axis1=1, axis2=2) > 0) == compressing]
            form = hypoplastic_form(plain, state, compressing)
            expected = stress_rate(plain, state, branch)
            np.testing.assert_allclose(form.stress_rate(branch), expected, atol=1e-11 * np.abs(expected).max())
        table2 = hypoplastic_form(model, state)
        assert 1e-6 < table2.misfit < 0.1  # approximate: |f A^c - A|^gamma depends on the direction
    assert hypoplastic_form(model, ModelState(0.67, 5.0, 0.005)).misfit < 1e-13  # exact where A = F = 0


@settings(max_examples=20)
@given(seed=SEEDS)
def test_volumetric_and_deviatoric_parts_add_up_and_the_volumetric_one_is_along_the_stress(seed):
    rng = np.random.default_rng(seed)
    state, D = random_state(rng), symmetric(rng, 1.0)
    volumetric = np.trace(D) / 3 * np.eye(3)
    whole, parts = (stress_rate(Model(), state, x) for x in (D, np.stack([volumetric, D - volumetric])))
    np.testing.assert_allclose(whole, parts.sum(axis=0), atol=1e-11 * np.abs(parts).max())
    form = hypoplastic_form(Model(), state, directions=30)
    ratio = form.Lv / state.stress()
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-8)


def test_isotropic_increments_have_a_symmetric_isotropic_tangent_at_an_isotropic_state(model):
    tangent = rate_tangent(model, isotropic_state(model, 0.67, 0.5e6), np.eye(3))
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-9 * tangent.max())
    np.testing.assert_allclose(tangent[3:, 3:], (tangent[0, 0] - tangent[0, 1]) * np.eye(3), rtol=1e-9)


def test_points_are_independent_and_a_failed_point_has_a_status(model):
    rng = np.random.default_rng(0)
    y = np.stack([random_state(rng).vector()[:21] for _ in range(50)])
    d = np.stack([to_six(symmetric(rng, 1e-4)) for _ in range(50)])
    together = update(model, y, d).require()
    alone = [update(model, y[k : k + 1], d[k : k + 1]) for k in range(50)]
    np.testing.assert_array_equal(together.stress, np.concatenate([u.stress for u in alone]))
    np.testing.assert_array_equal(together.tangent, np.concatenate([u.tangent for u in alone]))
    d[7] = to_six(-0.05 * np.eye(3))  # all contacts are lost
    failed = update(model, y, d)
    assert failed.status[7] != 0 and (np.delete(failed.status, 7) == 0).all()
    np.testing.assert_array_equal(failed.state[7], y[7])
    assert np.isnan(failed.stress[7]).all() and np.isnan(failed.tangent[7]).all()
    with pytest.raises(PhysicsError, match="point 7"):
        failed.require()


@pytest.mark.parametrize("increment", [np.zeros((2, 6)), np.zeros((3, 5)), np.full((3, 6), np.nan)])
def test_invalid_increments(model, increment):
    with pytest.raises(InputError):
        update(model, states(isotropic_state(model, 0.67, 0.5e6), 3), increment)


def test_softening_under_extension_after_compression(model):
    """The response is stiffer after a reversal: the hypoplastic N changes sign relative to the strain rate."""
    state = ModelState(0.67, 5.02, 0.0088, 0.4 * AXIS, 0.7 * AXIS, 0.04 * AXIS)
    on, back = (np.linalg.norm(stress_rate(model, state, sign * AXIS)) for sign in (1.0, -1.0))
    assert back > 3 * on
