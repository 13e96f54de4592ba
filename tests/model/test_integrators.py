"""Orders of convergence on a smooth path and with reversals; failing steps."""

import numpy as np
import pytest

from benchmarks.integrators import FIXED, Heun, Scipy
from labkit.errors import InputError
from labkit.model.controls import Mixed, model_path
from labkit.model.driver import drive
from labkit.model.integrators import Adaptive
from labkit.model.state import isotropic_state

AXIS = np.diag([-0.5, -0.5, 1.0])
STEPS = (1e-3, 5e-4, 2.5e-4)


def orders(model, path, start, integrator, record):
    """log2 of the ratio of errors from one step to its half, at the end of the path."""
    exact = drive(model, path, start, record, Adaptive(1e-12)).require().vector[-1, :21]
    scale = np.maximum(np.abs(exact), 1e-2)
    errors = [
        np.linalg.norm((drive(model, path, start, record, integrator(h)).require().vector[-1, :21] - exact) / scale)
        for h in STEPS
    ]
    return np.log2(np.array(errors[:-1]) / errors[1:])


@pytest.mark.parametrize("integrator", FIXED)
def test_order_with_reversals(model, integrator):
    """The rates are discontinuous at a reversal; integrating each piece separately preserves the order."""
    start = isotropic_state(model, 0.67, 0.5e6)
    path = model_path("cyclic_cp", 0.5e6, reversals=(0.01, -0.01, 0.01))
    found = orders(model, path, start, integrator, 0.02)
    np.testing.assert_allclose(found[-1], integrator.order, atol=0.35)


@pytest.mark.parametrize("name", ["cv", "cr", "cyclic_cp"])
def test_the_error_of_adaptive_follows_its_tolerance(model, name):
    start = isotropic_state(model, 0.67, 0.5e6)
    path = model_path(name, 0.5e6)
    exact = drive(model, path, start, integrator=Adaptive(1e-12)).require().stress
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = drive(model, path, start, 0.05, Adaptive(tolerance)).require().stress[-1]
        assert np.abs(found / 0.5e6 - exact[-1] / 0.5e6)[[0, 1, 2], [0, 1, 2]].max() < 50 * tolerance


@pytest.mark.parametrize("method", ["LSODA", "Radau", "DOP853"])
def test_methods_of_scipy_agree(model, method):
    start = isotropic_state(model, 0.67, 0.5e6)
    for name in ("cv", "cp"):
        path = model_path(name, 0.5e6, strain=0.1)
        found, own = (drive(model, path, start, 0.1, i).require().vector[-1] for i in (Scipy(method), Adaptive(1e-9)))
        np.testing.assert_allclose(found, own, rtol=2e-4, atol=2e-5)


@pytest.mark.parametrize("integrator", [Adaptive(), *(kind(1e-3) for kind in FIXED)])
def test_a_failing_step_gives_a_reason(model, integrator):
    """Dilation until the contacts are lost: every integrator ends with a reason, none with a clipped state."""
    path = Mixed(-np.eye(3) / 3, [], [], [], strain=0.2)
    result = drive(model, path, isotropic_state(model, 0.62, 0.5e6), integrator=integrator)
    assert result.failure and np.isfinite(result.vector).all()
    assert 0.01 < -result.strain[-1, 0, 0] * 3 < 0.04


def test_invalid_integrators():
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(InputError):
            Heun(bad)
    with pytest.raises(InputError, match="tolerance"):
        Adaptive(0.0)
