"""Evidence for the interpretations of ambiguous equations: the alternative contradicts the paper."""

import dataclasses
import json

import numpy as np
import pytest

from labkit.errors import InputError
from labkit.micro.tensors import to_tensor
from labkit.model import equations as eq
from labkit.model.controls import model_path
from labkit.model.driver import drive
from labkit.model.parameters import MEASURED_REVERSALS, DensityDependence, Model, Readings, Reversals
from labkit.model.state import ModelState, isotropic_state
from labkit.model.stiffness import state_rate
from labkit.model.strength import attractors


def test_with_the_factor_lambda_c4_does_not_reach_the_critical_state(model):
    """Figs. 4 to 6 reach it within 40 % strain; with |Lambda| in C4 less than a quarter of the change has occurred."""
    start = isotropic_state(model, 0.67, 0.2e6)
    path = model_path("cv", 0.2e6, strain=0.4)
    critical = 0.098 * (0.76 - 0.67)
    plain, scanned = (drive(m, path, start).require() for m in (model, model.reading(force_rate="with_force")))
    assert abs(plain.Lam[-1] / critical - 1) < 1e-3
    assert (scanned.Lam[-1] - start.Lam) < 0.25 * (critical - start.Lam)


def test_as_printed_compression_loses_contacts(model):
    start = isotropic_state(model, 0.67, 0.5e6, Z=5.2)
    path = model_path("isoc", 0.5e6)
    minus = drive(model, path, start).require()
    assert (np.diff(minus.Z) > 0).all()
    line = 4 + 7.2 * (0.76 - minus.e[-1]) ** 0.7
    assert abs(minus.Z[-1] - line) < 0.02  # tends to the compression line, as simulated tests do
    printed = drive(model.reading(compression="as_printed"), path, start)
    assert (np.diff(printed.Z) < 0).all()


def test_with_the_total_rate_isotropic_compression_tends_to_the_critical_state(model):
    state = isotropic_state(model, 0.67, 0.5e6)
    only_32 = 0.098 * 1.67  # f^{v,Lambda}
    rates = [state_rate(m, state, np.eye(3) / 3)[2] for m in (model, model.reading(strain_rate="total"))]
    assert np.isclose(rates[0], only_32) and not np.isclose(rates[1], only_32, rtol=0.1)


def test_beyond_e_cmax_is_an_error_unless_chosen(model, flat):
    with pytest.raises(InputError, match="e_cmax"):
        isotropic_state(model, 0.77, 0.5e6)
    start = isotropic_state(flat, 0.77, 0.5e6)
    assert start.Z == 4.0
    with pytest.raises(InputError, match="e_cmax"):
        drive(model, model_path("cp", 0.5e6), start)
    result = drive(flat, model_path("cp", 0.5e6, strain=0.6), start).require()
    assert abs(result.p / 0.5e6 - 1).max() < 1e-4
    assert 0.71 < result.e[-1] < 0.73  # contracts through e_cmax to the critical void ratio of 0.5 MPa


def test_flat_is_continuous_in_z_and_lambda(flat):
    c = flat.constants
    for function in (eq.critical_coordination_number, eq.critical_force, eq.compression_coordination_number):
        assert abs(function(0.76 - 1e-12, c) - function(0.76 + 1e-12, c)) < 1e-6
        assert function(0.80, c) == function(0.76, c)


def test_a_run_that_dilates_to_e_cmax_gives_the_reason(model, flat):
    start = isotropic_state(model, 0.755, 0.5e6)
    path = model_path("isod", 0.5e6)
    result = drive(model, path, start)
    assert "e_cmax" in result.failure and abs(result.e[-1] - 0.76) < 1e-9
    assert drive(flat, path, start).failure is None


def test_unknown_readings():
    with pytest.raises(InputError, match="flat"):
        Readings(beyond_e_cmax="linear")


def test_c4_by_distance_and_with_reported_void_ratios_keep_the_critical_state(model):
    """With both readings a CV test ends at Lambda^c; the reported void ratio is larger, so Lambda^c is lower."""
    start = isotropic_state(model, 0.67, 0.2e6)
    path = model_path("cv", 0.2e6, strain=0.6)
    distance = drive(model.reading(force_rate="distance"), path, start).require()
    assert distance.Lam[-1] == pytest.approx(0.098 * (0.76 - 0.67), rel=0.02)
    reported = drive(model.reading(line_void_ratio="reported"), path, start).require()
    line = 0.67 + 1.67 * 2.7 * reported.Z[-1] * reported.Lam[-1] ** 2
    assert line > 0.6715 and reported.Lam[-1] == pytest.approx(0.098 * (0.76 - line), rel=1e-3)


def test_the_amendment_acts_away_from_the_critical_stress_ratio_and_not_at_it(model):
    """After a reversal q/p is far below its critical value and Lambda falls; in the critical state nothing changes."""
    amended = dataclasses.replace(model, c_dLam=5.0)
    start = isotropic_state(model, 0.67, 0.2e6)
    both = [drive(m, model_path("cv", 0.2e6, strain=0.6), start).require() for m in (model, amended)]
    assert both[1].Lam[-1] == pytest.approx(both[0].Lam[-1], rel=1e-3)
    critical = ModelState.from_vector(both[0].vector[-1])
    back = np.diag([0.5, 0.5, -1.0])
    plain, lower = (state_rate(m, critical, back)[2] for m in (model, amended))
    assert lower < plain - 5.0 * critical.Lam
    with pytest.raises(InputError, match="c_dLam"):
        dataclasses.replace(model, c_dLam=-1.0)


def test_below_the_compression_line_z_can_change_parallel_to_it(model):
    c, line = model.reading(compression="parallel").constants, eq.compression_coordination_number(0.67, model.constants)
    slope = eq.compression_slope(0.67, c)
    assert eq.compression_gain(0.67, line - 1.0, c) == pytest.approx(-1.67 * slope)
    assert eq.compression_gain(0.67, line - 1.0, model.constants) == pytest.approx(-1.67 * slope * np.exp(3.0))
    assert eq.compression_gain(0.67, line + 0.1, c) == eq.compression_gain(0.67, line + 0.1, model.constants)


def test_attractors_that_depend_on_density(model):
    """A and F^t at the ends of two CV tests are the attractors at their void ratios."""
    dense = dataclasses.replace(model, density=DensityDependence(A_Z=-0.2, Ft_Z=0.3, F_d=0.5, Ft_d=0.2))
    for e in (0.62, 0.70):
        end = drive(dense, model_path("cv", 0.5e6, strain=0.8), isotropic_state(model, e, 0.5e6)).require()
        excess = eq.critical_coordination_number(e, dense.constants) - 4.0
        state = ModelState.from_vector(end.vector[-1])
        assert np.linalg.norm(state.A) == pytest.approx(model.parameters.A_c * (1.0 - 0.2 * excess), rel=0.03)
        assert np.linalg.norm(state.Ft) == pytest.approx(model.parameters.Ft_c * (1.0 + 0.3 * excess), rel=0.03)
        n = state.A / np.linalg.norm(state.A)
        np.testing.assert_allclose(attractors(n, dense, e)[2], state.Ft, atol=2e-3)
    with pytest.raises(InputError, match="A_Z"):
        DensityDependence(A_Z=2.0)


def test_reversals_make_F_stiff_and_grains_contract(model):
    """F grows by K_F (Z - Z_F) per strain where it is zero or opposed; Lambda changes its sign with A:n."""
    turning = dataclasses.replace(model, reversals=MEASURED_REVERSALS)
    terms, n = MEASURED_REVERSALS, np.diag([-0.5, -0.5, 1.0]) / np.sqrt(1.5)
    start = isotropic_state(model, 0.62, 0.5e6)
    K = terms.K_F * (start.Z - terms.Z_F)
    np.testing.assert_allclose(to_tensor(state_rate(turning, start, n)[9:15]), K * n, atol=1e-12 * K)
    loaded = dataclasses.replace(start, A=0.6 * n, F=0.8 * n, Lam=0.5 * start.Lam)
    back = state_rate(turning, loaded, -n)
    np.testing.assert_allclose(to_tensor(back[9:15]), -K * n, atol=1e-12 * K)
    forth, plain = state_rate(turning, loaded, n), state_rate(model, loaded, n)
    assert forth[2] == pytest.approx(-back[2])
    assert forth[2] / plain[2] == pytest.approx(0.6 / (terms.A_0 + terms.A_e * 0.62))
    full = dataclasses.replace(loaded, F=(terms.F_0 + terms.F_e * 0.62) * n)
    np.testing.assert_allclose(state_rate(turning, full, n)[9:15], 0.0, atol=1e-12 * K)
    with pytest.raises(InputError, match="K_F"):
        Reversals(K_F=-1.0)
    extension = -n
    for D in (n, extension):  # the critical state of `critical_section` is where F stays
        F = attractors(D, turning, 0.62)[1]
        rate = state_rate(turning, dataclasses.replace(start, F=F), D)[9:15]
        np.testing.assert_allclose(rate, 0.0, atol=1e-12 * K)


def test_a_model_is_read_back_from_its_file(model):
    density = DensityDependence(A_Z=-0.2)
    amended = dataclasses.replace(model.reading(force_rate="distance"), c_dLam=5.0, density=density)
    amended = dataclasses.replace(amended, reversals=MEASURED_REVERSALS)
    assert Model.from_json(amended.to_json()) == amended
    older = json.loads(model.to_json())
    del older["c_dLam"], older["density"], older["reversals"], older["readings"]["line_void_ratio"]
    assert Model.from_json(json.dumps(older)) == model
