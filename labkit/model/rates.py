"""Rate of the state vector under a strain rate or a control, by C1 to C5.

A state vector y holds e, Z, Lambda, A, F, F^t, 3 + 3 x 6 numbers in Mandel notation (labkit.model.tensors), followed by
the strain, on which the rates do not depend. All functions handle a single point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from labkit.model.compiled import Pointer, Table, always_inline, constants_at, entry, numbers_at
from labkit.model.constants import Constants
from labkit.model.differentials import STATE
from labkit.model.equations import strain_driven
from labkit.model.law import law_rates, law_stress, law_stress_rate
from labkit.model.tensors import Six, contract, put, put_six, trace

SIZE = 27  # numbers in a state vector: STATE and the strain
# Status of a rate: FINE, or the reason why it is undefined. REASONS are the texts for messages.
FINE, NOT_FINITE, NO_FORCE, NO_CONTACTS, TOO_LOOSE, NO_VOIDS, UNREACHABLE, TOO_MANY_STEPS, NO_CONVERGENCE, OUTSIDE = (
    range(10)
)
REASONS = {
    NOT_FINITE: "the state became NaN",
    NO_FORCE: "Lambda falls to zero: the contacts no longer carry force",
    NO_CONTACTS: "Z falls to zero: there are no contacts left",
    TOO_LOOSE: "the void ratio reaches e_cmax, beyond which Z^c is undefined: "
    "end the path earlier, or set beyond_e_cmax = flat (--beyond-e-cmax flat)",
    NO_VOIDS: "the void ratio falls to zero: the grains fill the whole volume; end the path earlier",
    UNREACHABLE: "no strain rate keeps the stress at its target: the target exceeds the strength of the material; "
    "hold other stresses, or prescribe more strain rates",
    TOO_MANY_STEPS: "too many steps: the equations are too stiff here for this integrator",
    OUTSIDE: "the state leaves the domain of the law: the mean stress falls to zero or the void ratio passes a limit; "
    "end the path earlier",
    NO_CONVERGENCE: "Newton's iteration of the implicit step does not converge: take smaller steps",
}


class PointControl(NamedTuple):
    """Strain rate D = given + free @ x, with x such that d(measure @ sigma)/dt = gain (target - measure @ sigma).

    The strain rate is per unit of the path's strain measure. With pore water, sigma is the total stress.

    Args:
        given: Prescribed strain rate, and K_w/n of the pore water, Pa, or 0, (7,).
        free: Directions of the free strain rates, (6, k).
        measure: Stresses to hold, as tensors, (k, 6).
        target: Targets of the held stresses, (k,), Pa.
        gain: Corrects the drift of the integrator, per unit of strain; it is not a stiffness.
    """

    given: np.ndarray
    free: np.ndarray
    measure: np.ndarray
    target: np.ndarray
    gain: float


def outside(y: np.ndarray, c: Constants) -> int:
    """Return FINE, or the reason why the equations are undefined at e, Z, Lambda, A, F, F^t.

    1/Lambda^gamma and c_vZ/Lambda are singular at Lambda = 0, Z^c and Z^com are undefined beyond e_cmax, and C0 gives
    no stress at Z = 0. Z = 4 is not a boundary: Z^c and Z^com reach it at e_cmax, where dZ^com/de is infinite, and C2
    passes through it. In dilation Eqs. 31 and 32 reduce Z to zero before Lambda, as dZ/dLambda is proportional to
    1/Lambda.
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


def model_rates(y: np.ndarray, D: Six, compressing: bool, c: Constants, out: np.ndarray) -> int:
    """Write the rates of a state vector to `out`; returns FINE, or the reason why they are undefined (`outside`)."""
    status = outside(y, c)
    if status == FINE:
        strain_driven(y, D, compressing, c, out)
    return status


def _strain_rate(u, x):
    """Return the strain rate of a control u with the free rates x."""
    return Six(_rate(u, x, 0), _rate(u, x, 1), _rate(u, x, 2), _rate(u, x, 3), _rate(u, x, 4), _rate(u, x, 5))


def _rate(control, x, i):
    rate = control.given[i]
    for j in range(x.size):
        rate += control.free[i, j] * x[j]
    return rate


def _residual(y, control, x, compressing, c, out, missing):
    """Write d(measure @ sigma)/dt - gain (target - measure @ sigma) to `missing` and dy/dt to `out`; return a scale."""
    D = _strain_rate(control, x)
    status = law_rates(y, D, compressing, c, out)
    if status != FINE:
        missing[:] = np.nan
        return np.nan
    sigma, sigma_rate = law_stress(y, c), law_stress_rate(y, out, c)
    size = 0.0
    for k in range(x.size):
        water = control.given[6] * (control.measure[k, 0] + control.measure[k, 1] + control.measure[k, 2])
        target, change = water * (y[y.size - 6] + y[y.size - 5] + y[y.size - 4]), water * trace(D)
        for i in range(6):
            target += control.measure[k, i] * sigma[i]
            change += control.measure[k, i] * sigma_rate[i]
        missing[k] = change - control.gain * (control.target[k] - target)
        size = max(size, abs(control.gain * control.target[k]))
    return size + np.sqrt(contract(sigma_rate, sigma_rate))


NEWTON_STEPS = 20
FASTEST = 1e4  # largest ratio of free to prescribed strain rate; beyond it the target is treated as unreachable
WORK = (11, 6)  # shape of the work array of `rates`: a Jacobian, four vectors, and the first guess
SINGULAR = 1e-14  # a matrix scaled to the largest entry 1 is treated as singular if its determinant is smaller


def _size(v):
    """Return |v|."""
    total = 0.0
    for i in range(v.size):
        total += v[i] * v[i]
    return np.sqrt(total)


def solve_linear(A: np.ndarray, b: np.ndarray) -> bool:
    """Solve A v = b by Gaussian elimination with pivoting; v overwrites b. False if A is singular or not finite.

    For the few rows of a control this compiles several times faster than np.linalg.solve.
    """
    k, largest, determinant = b.size, 0.0, 1.0
    for i in range(k):
        for j in range(k):
            if not np.isfinite(A[i, j]):
                return False
            largest = max(largest, abs(A[i, j]))
    for i in range(k):
        pivot = i
        for row in range(i + 1, k):
            if abs(A[row, i]) > abs(A[pivot, i]):
                pivot = row
        for j in range(k):
            A[i, j], A[pivot, j] = A[pivot, j], A[i, j]
        b[i], b[pivot] = b[pivot], b[i]
        determinant *= A[i, i] / (largest + 1e-300)
        if A[i, i] == 0.0:
            return False
        for row in range(i + 1, k):
            factor = A[row, i] / A[i, i]
            for j in range(i, k):
                A[row, j] -= factor * A[i, j]
            b[row] -= factor * b[i]
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
    return abs(determinant) >= SINGULAR


def _newton(y, control, x, compressing, c, out, work):
    """Solve for x on one branch of Eqs. 31 and 32; True if converged. Leaves x and `out` at the last iterate."""
    k, jacobian = x.size, work[:6]
    missing, tried, start, step = work[6, :k], work[7, :k], work[8, :k], work[9, :k]
    size = _residual(y, control, x, compressing, c, out, missing)
    error = _size(missing)
    for _ in range(NEWTON_STEPS):
        if error <= 1e-13 * size or error == 0.0:
            return True
        for j in range(k):
            unchanged, nudge = x[j], 1e-7 * (1.0 + abs(x[j]))
            x[j] = unchanged + nudge
            _residual(y, control, x, compressing, c, out, tried)
            x[j] = unchanged
            for i in range(k):
                jacobian[i, j] = (tried[i] - missing[i]) / nudge
        put(start, x)
        put(step, missing)
        if not solve_linear(jacobian, step):
            return False
        before, length = error, 1.0
        while True:
            for i in range(k):
                x[i] = start[i] - length * step[i]
            size = _residual(y, control, x, compressing, c, out, missing)
            error = _size(missing)
            if error < before or length < 1e-3:
                break
            length *= 0.5
        if not np.isfinite(error):
            return False
        for i in range(k):
            if abs(x[i]) > FASTEST:
                return False
        if error >= before:  # limited by rounding, or not converging
            put(x, start)
            _residual(y, control, x, compressing, c, out, missing)
            return before <= 1e-9 * size
    return error <= 1e-9 * size


@always_inline
def rates(y: np.ndarray, control: PointControl, x: np.ndarray, c: Constants, out: np.ndarray, work: np.ndarray) -> int:
    """Write dy/dt under a control to `out`, which has the size of y; returns FINE, or why the rate is undefined.

    `x` (k,) holds the free rates and, on input, their initial guess. The branch of Eqs. 31 and 32 must agree with the
    sign of the resulting volumetric rate. The branch of the guess is tried first; if the volumetric stiffness is
    positive, at most one branch agrees. `work` (WORK) is overwritten.
    """
    D = _strain_rate(control, x)
    status = law_rates(y, D, trace(D) > 0.0, c, out)
    if status != FINE or x.size == 0:
        put_six(out, y.size - 6, D)
        return status
    first = trace(D) > 0.0
    guess = work[10, : x.size]
    put(guess, x)
    for start in (1.0, 0.0, -1.0):
        for compressing in (first, not first):
            for i in range(x.size):
                x[i] = start * guess[i]
            if _newton(y, control, x, compressing, c, out, work):
                D = _strain_rate(control, x)
                volumetric = trace(D)
                if compressing == (volumetric > 0.0) or abs(volumetric) < 1e-12:
                    put_six(out, y.size - 6, D)
                    return FINE
    put(x, guess)
    return UNREACHABLE


class RateTask(NamedTuple):
    """The inputs of a law's rates other than the state, and the memory in which the rates are computed.

    Args:
        control: Control of the point.
        x: Free rates, (k,), stored between calls as the initial guess.
        constants: Constants of the law.
        floor: The law's floor for each component (ConstitutiveLaw.floor).
        stages: (9, size of a state), overwritten.
        work: Work array of shape WORK, overwritten.
    """

    control: PointControl
    x: np.ndarray
    constants: Constants
    floor: np.ndarray
    stages: np.ndarray
    work: np.ndarray


def task_at(table: Table, n: int, k: int) -> RateTask:
    """Return the RateTask of a table (labkit.model.integrators.Problem), for n variables and k free rates."""
    fixed = numbers_at(table[0], 8 + k)  # given, gain and target
    free, measure = numbers_at(table[1], (6, k)), numbers_at(table[2], (k, 6))
    control = PointControl(fixed[:7], free, measure, fixed[8:], fixed[7])
    x, floor, stages = numbers_at(table[3], k), numbers_at(table[5], n), numbers_at(table[6], (9, n))
    return RateTask(control, x, constants_at(table[4]), floor, stages, numbers_at(table[7], WORK))


@entry
def rates_at(y: Pointer, out: Pointer, table: Table, n: int, k: int) -> int:
    """Call `rates` with the arrays of labkit.model.integrators.Problem."""
    task = task_at(table, n, k)
    return rates(numbers_at(y, n), task.control, task.x, task.constants, numbers_at(out, n), task.work)
