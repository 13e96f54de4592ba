"""The equations together: from a state vector and a strain rate, or a control, to the rate of the state vector.

A state vector y holds e, Z, Lambda, A, F, F^t, 3 + 3 x 6 numbers in Mandel's order (labkit.model.tensors), and
behind them the strain, on which nothing depends. Everything here is compiled and works on one point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from labkit.model import equations as eq
from labkit.model.compiled import compiled
from labkit.model.parameters import Constants
from labkit.model.tensors import Six, load, store

STATE = 21  # e, Z, Lambda, A, F, F^t
SIZE = 27  # and the strain
# Why a rate has no value. The first is no failure; REASONS are for messages.
FINE, NOT_FINITE, NO_FORCE, NO_CONTACTS, TOO_LOOSE, NO_VOIDS, UNREACHABLE, TOO_MANY_STEPS, NO_CONVERGENCE = range(9)
REASONS = {
    NOT_FINITE: "the state became NaN",
    NO_FORCE: "Lambda falls to zero: the contacts have lost their forces",
    NO_CONTACTS: "Z falls to zero: there are no contacts left",
    TOO_LOOSE: "the void ratio reaches e_cmax, beyond which Z^c has no value: "
    "end the path before, or choose the reading beyond_e_cmax = flat (--beyond-e-cmax flat)",
    NO_VOIDS: "the void ratio falls to zero: the grains fill all space, end the path before",
    UNREACHABLE: "no strain rate brings the stress where the control wants it: the control asks for more than the "
    "material bears, hold other stresses or give more of the strain rates",
    TOO_MANY_STEPS: "too many steps: the equations are too stiff here for this integrator",
    NO_CONVERGENCE: "Newton's iteration of the implicit step does not converge: take smaller steps",
}


class Control(NamedTuple):
    """Strain rate D = given + free @ x, with x such that d(measure @ sigma)/dt = gain (target - measure @ sigma).

    given (6,), free (6, k), measure (k, 6), target (k,) Pa. The strain rate is per unit of the path's own measure
    of strain. `gain`, per unit of strain, takes the drift of the integrator back; it is no stiffness.
    """

    given: np.ndarray
    free: np.ndarray
    measure: np.ndarray
    target: np.ndarray
    gain: float


@compiled
def outside(y: np.ndarray, c: Constants) -> int:
    """FINE, or why the equations have no value at e, Z, Lambda, A, F, F^t.

    1/Lambda^gamma and c_vZ/Lambda end at Lambda = 0, Z^c and Z^com at e_cmax, and C0 makes no stress of Z = 0. Z = 4 is
    no end: the lines reach it at e_cmax, where dZ^com/de is infinite, and C2 goes through it. In dilation Eqs. 31
    and 32 take Z to zero before Lambda, as dZ/dLambda is proportional to 1/Lambda.
    """
    for k in range(STATE):
        if not np.isfinite(y[k]):
            return NOT_FINITE
    if y[2] <= 0.0:
        return NO_FORCE
    if y[1] <= 0.0:
        return NO_CONTACTS
    if y[0] <= 0.0:
        return NO_VOIDS
    if y[0] >= c.e_cmax and not c.flat:
        return TOO_LOOSE
    return FINE


@compiled
def strain_driven(y: np.ndarray, D: Six, compressing: bool, c: Constants, out: np.ndarray) -> None:
    """dy/dt into `out` (at least 21,) for the strain rate D, C1 to C5.

    `compressing` chooses the branch of Eqs. 31 and 32.
    """
    e, Z, Lam = y[0], y[1], y[2]
    n, rate, volumetric = eq.split_rate(D, c)
    A_rate = eq.contact_anisotropy_rate(load(y, 3), e, Lam, n, rate, c)
    out[0] = eq.void_ratio_rate(e, volumetric)
    out[1] = eq.coordination_number_rate(Z, e, Lam, A_rate, rate, volumetric, compressing, c)
    out[2] = eq.mean_force_rate(e, Lam, rate, volumetric, compressing, c)
    store(out, 3, A_rate)
    store(out, 9, eq.normal_force_anisotropy_rate(load(y, 9), e, Lam, n, rate, c))
    store(out, 15, eq.mobilisation_rate(load(y, 15), n, rate, c))


@compiled
def stress_of(y: np.ndarray, c: Constants) -> Six:
    """C0 at y, Pa."""
    return eq.stress(y[0], y[1], y[2], load(y, 3), load(y, 9), load(y, 15), c)


@compiled
def stress_rate_of(y: np.ndarray, v: np.ndarray, c: Constants) -> Six:
    """d sigma/dt for dy/dt = v (Eq. 33 with its coupled terms), Pa/s."""
    return eq.stress_rate(
        y[0], y[1], y[2], load(y, 3), load(y, 9), load(y, 15), v[0], v[1], v[2], load(v, 3), load(v, 9), load(v, 15), c
    )


@compiled
def _strain_rate(control, x):
    D = np.empty(6)
    for i in range(6):
        D[i] = control.given[i]
        for j in range(x.size):
            D[i] += control.free[i, j] * x[j]
    return load(D, 0)


@compiled
def _missing(y, control, x, compressing, c, out, found):
    """d(measure @ sigma)/dt - gain (target - measure @ sigma) into `found`; its scale, Pa. Fills `out` too."""
    D = _strain_rate(control, x)
    strain_driven(y, D, compressing, c, out)
    sigma, sigma_rate = stress_of(y, c), stress_rate_of(y, out, c)
    size = 0.0
    for k in range(x.size):
        held, change = 0.0, 0.0
        for i in range(6):
            held += control.measure[k, i] * sigma[i]
            change += control.measure[k, i] * sigma_rate[i]
        found[k] = change - control.gain * (control.target[k] - held)
        size = max(size, abs(control.gain * control.target[k]))
    return size + np.sqrt(eq.dot(sigma_rate, sigma_rate))


NEWTON_STEPS = 20
FASTEST = 1e4  # strain rate over the one that is given: beyond it the target counts as unreachable


@compiled
def _newton(y, control, x, compressing, c, out):
    """Finds x on one branch of Eqs. 31, 32; whether it was found. Leaves x and `out` at the last iterate."""
    k = x.size
    found, tried, jacobian = np.empty(k), np.empty(k), np.empty((k, k))
    size = _missing(y, control, x, compressing, c, out, found)
    error = np.sqrt(np.sum(found * found))
    for _ in range(NEWTON_STEPS):
        if error <= 1e-13 * size or error == 0.0:
            return True
        for j in range(k):
            kept, step = x[j], 1e-7 * (1.0 + abs(x[j]))
            x[j] = kept + step
            _missing(y, control, x, compressing, c, out, tried)
            x[j] = kept
            for i in range(k):
                jacobian[i, j] = (tried[i] - found[i]) / step
        if not np.isfinite(jacobian).all() or abs(np.linalg.det(jacobian / (np.abs(jacobian).max() + 1e-300))) < 1e-14:
            return False
        step = np.linalg.solve(jacobian, found)
        before, length = error, 1.0
        start = x.copy()
        while True:
            x[:] = start - length * step
            size = _missing(y, control, x, compressing, c, out, found)
            error = np.sqrt(np.sum(found * found))
            if error < before or length < 1e-3:
                break
            length *= 0.5
        if not np.isfinite(error) or np.abs(x).max() > FASTEST:
            return False
        if error >= before:  # rounding is all that is left, or nothing helps
            x[:] = start
            error = np.sqrt(np.sum(found * found))
            _missing(y, control, x, compressing, c, out, found)
            return before <= 1e-9 * size
    return error <= 1e-9 * size


@compiled
def rates(y: np.ndarray, control: Control, x: np.ndarray, c: Constants, out: np.ndarray) -> int:
    """dy/dt into `out` (27,) under a control; FINE or why there is none. `x` (k,): the free rates, first the guess.

    The branch of Eqs. 31 and 32 must fit the volumetric rate that comes out. The branch of the guess is tried
    first; at most one of them fits where the volumetric stiffness is positive.
    """
    status = outside(y, c)
    if status != FINE:
        return status
    if x.size == 0:
        D = _strain_rate(control, x)
        strain_driven(y, D, eq.trace(D) > 0.0, c, out)
        store(out, STATE, D)
        return FINE
    first = eq.trace(_strain_rate(control, x)) > 0.0
    guess = x.copy()
    for start in (1.0, 0.0, -1.0):
        for compressing in (first, not first):
            x[:] = start * guess
            if _newton(y, control, x, compressing, c, out):
                D = _strain_rate(control, x)
                volumetric = eq.trace(D)
                if compressing == (volumetric > 0.0) or abs(volumetric) < 1e-12:
                    store(out, STATE, D)
                    return FINE
    x[:] = guess
    return UNREACHABLE


@compiled
def jacobian(y: np.ndarray, control: Control, x: np.ndarray, c: Constants, out: np.ndarray) -> int:
    """d(dy/dt)/dy (27, 27) by central differences into `out`; FINE or why there is none."""
    plus, minus, shifted, guess = np.empty(SIZE), np.empty(SIZE), y.copy(), x.copy()
    for k in range(SIZE):
        step = 1e-6 * max(abs(y[k]), 1e-3 if k != 2 else 0.0)
        shifted[k] = y[k] + step
        status = rates(shifted, control, guess, c, plus)
        if status != FINE:
            return status
        shifted[k] = y[k] - step
        status = rates(shifted, control, guess, c, minus)
        if status != FINE:
            return status
        shifted[k] = y[k]
        for i in range(SIZE):
            out[i, k] = (plus[i] - minus[i]) / (2.0 * step)
    return FINE
