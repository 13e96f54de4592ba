"""The driver: the critical state from any start, the stresses held by each path, reversals, and failures."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from labkit.errors import InputError, PhysicsError
from labkit.model.controls import Mixed, Oedometer, model_path, strain_control
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive, Problem
from labkit.model.parameters import Model
from labkit.model.rates import solve_linear
from labkit.model.state import ModelState, inherent_anisotropy, isotropic_force_anisotropy, isotropic_state
from tests.model.random_states import AXIS, deviator, rotation
from tests.model.scalar_formulas import scalar_rates, scalar_stress

FLAT = Model().reading(beyond_e_cmax="flat")
LONG = 2.0  # axial strain; Z relaxes over about a fifth of it


def critical(e):
    """Z and Lambda on their lines."""
    return 4 + 5.57 * (0.76 - e) ** 0.7, 0.098 * (0.76 - e)


def assert_critical(result):
    """q/p = 0.93, Z and Lambda on their lines, the tensors at Table 2's values, and vanishing rates."""
    end = result.require().state()
    Z, Lam = critical(end.e)
    assert abs(result.q[-1] / result.p[-1] - 0.93) < 0.005
    assert abs(end.Z / Z - 1) < 2e-3 and abs(end.Lam / Lam - 1) < 2e-3
    for tensor, value in ((end.A, 0.45), (end.F, 0.77), (end.Ft, 0.045)):
        np.testing.assert_allclose(tensor, value * AXIS, atol=5e-3 * value)
    last, before = result.vector[-1, :21], result.vector[-11, :21]
    assert (np.abs(last - before) / np.maximum(np.abs(last), 0.1)).max() < 3e-3


@settings(max_examples=12)
@given(e=st.floats(0.56, 0.74), Z=st.floats(4.0, 6.5), Lam=st.floats(5e-4, 0.02), seed=st.integers(0, 999))
def test_cv_ends_at_the_critical_state_from_any_start(e, Z, Lam, seed):
    rng = np.random.default_rng(seed)
    start = ModelState(e, Z, Lam, deviator(rng, 0.3), deviator(rng, 0.3), deviator(rng, 0.05))
    result = drive(Model(), model_path("cv", 0.5e6, strain=LONG), start, 0.02)
    assert_critical(result)
    assert np.ptp(result.e) < 1e-12


@settings(max_examples=12)
@given(
    e=st.floats(0.59, 0.79), pressure=st.floats(0.1e6, 2e6), Z=st.floats(4.2, 6.0), name=st.sampled_from(["cr", "cp"])
)
def test_cr_and_cp_end_at_the_critical_state_from_any_start(e, pressure, Z, name):
    result = drive(FLAT, model_path(name, pressure, strain=LONG), isotropic_state(FLAT, e, pressure, Z=Z), 0.02)
    assert_critical(result)
    held = result.stress[:, :2, [0, 1]].diagonal(axis1=1, axis2=2) if name == "cr" else result.p
    assert np.abs(held / pressure - 1).max() < 1e-4


@pytest.mark.parametrize("e", [0.60, 0.67, 0.72])
@pytest.mark.parametrize("name", ["cv", "cr", "cp"])
def test_the_critical_state_is_a_fixed_point(model, name, e):
    """A state that starts at the critical state stays there under any strain."""
    Z, Lam = critical(e)
    start = ModelState(e, Z, Lam, 0.45 * AXIS, 0.77 * AXIS, 0.045 * AXIS)
    stress = start.stress()
    held = stress[0, 0] if name == "cr" else np.trace(stress) / 3
    result = drive(model, model_path(name, held, strain=0.3), start).require()
    scale = np.maximum(np.abs(start.vector()[:21]), 1e-3)
    assert (np.abs(result.vector[:, :21] - start.vector()[:21]) / scale).max() < 1e-6
    assert np.allclose(result.q / result.p, 0.9295, atol=5e-5)  # with C0's coupled terms; 0.934 without


@pytest.mark.parametrize("name", ["cv", "oedometer", "isoc", "cp"])
def test_a_whole_run_equals_the_scalar_formulas(model, name):
    """Integrated by scipy, with the free radial rate of CP from dp/dt = 0; statistics and stress agree."""
    start = isotropic_state(model, 0.67, 0.5e6)
    result = drive(model, model_path(name, 0.5e6, strain=0.02), start, 0.005, Adaptive(1e-10)).require()

    def pressure_rate(radial, y):
        h = 1e-6
        v = scalar_rates(*y, 1.0, radial)
        return (scalar_stress(*(y + h * v))[0] - scalar_stress(*(y - h * v))[0]) / (2 * h)

    def rate(t, y):
        radial = {"cv": -0.5, "oedometer": 0.0, "isoc": 1.0}.get(name)
        return scalar_rates(*y, 1.0, brentq(pressure_rate, -1.5, 0.5, (y,)) if radial is None else radial)

    y0 = [start.e, start.Z, start.Lam, 0.0, 0.0, 0.0]
    found = solve_ivp(rate, (0.0, 0.02), y0, "DOP853", t_eval=result.axial_strain, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(result.vector[:, [0, 1, 2, 5, 11, 17]].T, found, rtol=1e-6, atol=1e-7)
    p, q = scalar_stress(*found)
    np.testing.assert_allclose(result.p, p, rtol=1e-6)
    np.testing.assert_allclose(result.q, q, rtol=1e-6, atol=1.0)


def test_extension_ends_at_the_mirrored_critical_state(model):
    path = Mixed(-AXIS, [], [], [], strain=f"{100 * LONG} %")
    result = drive(model, path, isotropic_state(model, 0.67, 0.5e6), 0.02).require()
    np.testing.assert_allclose(result.state().A, -0.45 * AXIS, atol=1e-3)
    assert result.q[-1] < 0


def test_isotropic_paths_leave_the_tensors_alone_and_follow_eq_32(model):
    rng = np.random.default_rng(1)
    start = isotropic_state(model, 0.67, 0.5e6)
    start = ModelState(start.e, start.Z, start.Lam, deviator(rng, 0.2), deviator(rng, 0.3), deviator(rng, 0.02))
    for name, sign, slope in (("isoc", 1, 0.098), ("isod", -1, 0.075)):
        result = drive(model, model_path(name, 0.5e6), start).require()
        assert np.ptp(result.vector[:, 3:21], axis=0).max() == 0.0
        assert (sign * np.diff(result.Z) > 0).all() and (sign * np.diff(result.p) > 0).all()
        np.testing.assert_allclose(result.Lam, start.Lam + slope * (start.e - result.e), rtol=1e-9)
        np.testing.assert_allclose(1 + result.e, 1.67 * np.exp(-3 * result.axial_strain), rtol=1e-9)


def test_isotropic_paths_stop_at_their_pressure(model):
    start = isotropic_state(model, 0.67, 0.5e6)
    assert np.isclose(drive(model, model_path("isoc", 0.5e6), start).p[-1], 3e6, rtol=1e-6)
    assert np.isclose(drive(model, model_path("isod", 0.5e6, 1e5), start).p[-1], 1e5, rtol=1e-6)


def test_cyclic_cp_reverses_at_its_strains_and_holds_the_mean_stress(model):
    result = drive(model, model_path("cyclic_cp", 0.5e6), isotropic_state(model, 0.6, 0.5e6)).require()
    strain = result.axial_strain
    turns = strain[1:-1][np.diff(strain)[1:] * np.diff(strain)[:-1] < 0]
    np.testing.assert_allclose(turns, [0.01, -0.01, 0.02, -0.02, 0.03, -0.03], atol=1e-12)
    assert abs(result.p / 0.5e6 - 1).max() < 1e-5
    assert result.q.min() < -0.3e6 and result.q.max() > 0.3e6


def test_oedometer_has_no_lateral_strain(model):
    result = drive(model, Oedometer(), isotropic_state(model, 0.67, 0.5e6)).require()
    assert np.abs(result.strain[:, :2]).max() == 0.0
    assert (np.diff(result.stress[:, 2, 2]) > 0).all()
    assert 0.3 < result.stress[-1, 0, 0] / result.stress[-1, 2, 2] < 0.7  # K0


@pytest.mark.slow
def test_mixed_control_of_a_shear_stress(model):
    """Simple shear under constant normal stresses: three normal stresses held, eps_xz prescribed."""
    start = isotropic_state(model, 0.67, 0.5e6)
    shear = np.zeros((3, 3))
    shear[0, 2] = shear[2, 0] = 0.5
    normal = np.stack([np.diag(row) for row in np.eye(3)])
    result = drive(model, Mixed(shear, normal, normal, np.full(3, 0.5e6), strain=0.5), start).require()
    np.testing.assert_allclose(result.stress.diagonal(axis1=1, axis2=2), 0.5e6, rtol=1e-4)
    np.testing.assert_allclose(result.strain[:, 0, 2], np.linspace(0, 0.25, len(result)), atol=1e-12)
    assert result.stress[-1, 0, 2] > 0.1e6
    end = result.state()
    assert abs(end.Lam / critical(end.e)[1] - 1) < 0.02  # a different stress path, but the same critical state line


def test_a_path_rotated_with_its_state_gives_the_rotated_stress(model):
    """Objectivity of a complete path with tensors that are not coaxial with it."""
    rng = np.random.default_rng(5)
    Q = rotation(rng)
    A = inherent_anisotropy(0.3, 0.7)
    start = ModelState(0.67, 5.0, 0.004, A, isotropic_force_anisotropy(A))
    plain = drive(model, Mixed(AXIS, [], [], [], strain=0.1), start).require()
    turned = drive(model, Mixed(Q @ AXIS @ Q.T, [], [], [], strain=0.1), start.rotate(Q)).require()
    stress = Q @ plain.stress @ Q.T
    # the step length depends on components, so that this holds within the tolerance of the integrator
    np.testing.assert_allclose(turned.stress, stress, atol=1e-5 * np.abs(stress).max())


def test_an_anisotropic_start_under_isotropic_stress():
    A = inherent_anisotropy(0.3, 0.4)
    for exact, limit in ((True, 1e-14), (False, 3e-3)):
        stress = ModelState(0.7, 5.0, 0.004, A, isotropic_force_anisotropy(A, exact)).stress()
        principal = np.linalg.eigvalsh(stress)
        assert (principal[2] - principal[0]) / principal.mean() < limit
    assert (principal[2] - principal[0]) / principal.mean() > 1e-3  # the paper's F0 is isotropic to first order only


def test_lambda_close_to_zero_is_integrated_and_loose_specimens_lose_their_pressure(flat):
    start = ModelState(0.77, 4.0, 1e-6)
    result = drive(flat, model_path("cv", 1.0, strain=0.5), start).require()
    assert (result.Lam > 0).all() and result.Lam[-1] < 1e-6
    loose = drive(flat, model_path("cv", 0.5e6, strain=1.0), isotropic_state(flat, 0.77, 0.5e6)).require()
    assert loose.p[-1] < 0.03 * 0.5e6 and (np.diff(loose.Lam) < 0).all()


def test_a_path_ends_where_the_contacts_are_lost(model):
    """Dilation reduces Z to zero before Lambda (Eqs. 31, 32): the path ends there and gives the reason."""
    path = Mixed(-np.eye(3) / 3, [], [], [], strain=0.1)
    result = drive(model, path, isotropic_state(model, 0.62, 0.5e6))
    assert "no contacts left" in result.failure
    assert 0.0 < result.Z[-1] < 1e-3 and np.isfinite(result.vector).all()
    with pytest.raises(PhysicsError, match=re.escape(result.failure)):
        result.require()


def test_a_path_ends_where_no_voids_are_left(model):
    result = drive(model, model_path("isoc", 0.1e6, strain=0.1), isotropic_state(model, 0.05, 0.1e6))
    assert "void ratio falls to zero" in result.failure and 0.0 < result.e[-1] < 1e-6


def test_a_path_ends_where_its_stress_cannot_be_held(model):
    """In a specimen far denser than those of the paper, no radial strain rate holds the mean stress during shear.

    Lambda grows faster with |rate| than dilation reduces it.
    """
    result = drive(model, model_path("cp", 0.5e6), isotropic_state(model, 0.54, 0.5e6))
    assert "no strain rate keeps the stress" in result.failure
    shear = Mixed(AXIS, [np.eye(3) / 3], [AXIS], [1e6], strain=0.1)  # q = 1 MPa at p = 0.5 MPa
    with pytest.raises(InputError, match="isoc"):
        drive(model, shear, isotropic_state(model, 0.67, 0.5e6))


def test_initial_states_that_do_not_fit_the_path(model):
    start = isotropic_state(model, 0.67, 0.5e6)
    for name in ("cr", "cp", "cyclic_cp"):
        with pytest.raises(InputError, match="initial stress differs"):
            drive(model, model_path(name, 0.6e6), start)
    message = (
        "^stop_pressure 600000 stops isod immediately, because the initial mean stress is 500000 Pa: "
        "give a stress reached later on the path$"
    )
    with pytest.raises(InputError, match=message):
        drive(model, model_path("isod", 0.5e6, 0.6e6), start)
    with pytest.raises(InputError, match="contacts that carry force"):
        drive(model, model_path("cv", 0.5e6), ModelState(0.67, 5.0, 0.0))


@pytest.mark.parametrize(
    "change",
    [
        {"strain_rate": np.triu(np.ones((3, 3)))},
        {"free": [np.eye(3)]},
        {"strain": -1.0},
        {"strain": np.nan},
        {"free": [np.triu(np.ones((3, 3)))], "measured": [np.eye(3)], "target": [1.0]},
        {"free": [np.eye(3)], "measured": [np.eye(3)], "target": [np.nan]},
    ],
)
def test_invalid_mixed_controls(change):
    with pytest.raises(InputError):
        Mixed(**{"strain_rate": np.zeros((3, 3)), "free": [], "measured": [], "target": [], **change})


def test_initial_states(model):
    start = isotropic_state(model, 0.67, 0.5e6)
    assert np.isclose(start.Z, 4 + 7.2 * 0.09**0.7)
    np.testing.assert_allclose(start.stress(), 0.5e6 * np.eye(3), atol=1e-6)
    given = isotropic_state(model, 0.67, 0.5e6, Lam=0.003)
    np.testing.assert_allclose(given.stress(), 0.5e6 * np.eye(3), atol=1e-6)
    for change in ({"Z": -1.0}, {"Z": 0.0}, {"Lam": -1.0}, {"Z": 5.0, "Lam": 0.01}):
        with pytest.raises(InputError):
            isotropic_state(model, 0.67, 0.5e6, **change)
    for e, p in ((0.76, 1e5), (0.9, 1e5), (-0.1, 1e5), (np.nan, 1e5), (0.67, 0.0), (0.67, np.inf)):
        with pytest.raises(InputError):
            isotropic_state(model, e, p)


def test_a_strain_driven_piece_and_its_pieces_agree(model):
    start = isotropic_state(model, 0.67, 0.5e6).vector()
    control = strain_control(AXIS)
    whole = Adaptive(1e-10).advance(Problem(model, control), start, 0.2)
    integrator, y = Adaptive(1e-10), start
    for _ in range(7):
        y = integrator.advance(Problem(model, control), y, 0.2 / 7)
    np.testing.assert_allclose(y, whole, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("rows", range(1, 7))
def test_rates_of_held_stresses_are_solved_for_like_numpy(rows):
    rng = np.random.default_rng(rows)
    A, b = rng.normal(size=(rows, rows)), rng.normal(size=rows)
    A[0, 0] = 0.0 if rows > 1 else 2.0  # rows must be exchanged
    v = b.copy()
    assert solve_linear(A.copy(), v)
    np.testing.assert_allclose(v, np.linalg.solve(A, b), rtol=1e-10)
    for wrong in (0.0, np.nan):
        A[-1] = wrong
        assert not solve_linear(A.copy(), b.copy())


def test_a_pressure_may_have_a_unit():
    assert isotropic_state(Model(), 0.67, "300 kPa").Lam == isotropic_state(Model(), 0.67, 3e5).Lam
    with pytest.raises(InputError, match="'Torr'"):
        isotropic_state(Model(), 0.67, "3 Torr")
