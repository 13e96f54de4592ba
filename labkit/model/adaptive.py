"""The Dormand-Prince 5(4) pair, compiled as one loop: the default integrator.

Dormand and Prince, A family of embedded Runge-Kutta formulae, J. Comput. Appl. Math. 6 (1980) 19-26.
"""

from __future__ import annotations

import numpy as np

from labkit.model.compiled import jit
from labkit.model.parameters import Constants
from labkit.model.rates import FINE, SIZE, TOO_MANY_STEPS, PointControl, rates

NODES = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
FLOOR = np.full(SIZE, 0.1)  # the error of a smaller component is relative to this value, not to the component
FLOOR[2] = 1e-4  # Lambda is 1e-3 to 1e-2
SMALLEST = 1e-13  # strain step at which a boundary counts as reached


@jit
def advance_adaptively(
    y: np.ndarray,
    span: float,
    step: float,
    control: PointControl,
    x: np.ndarray,
    c: Constants,
    tolerance: float,
    most_steps: int,
) -> tuple[int, float, int, float]:
    """Integrate y (27,) over `span` in place. Returns (status, next step length, number of steps, strain covered).

    `step`: initial step length; `x` (k,): the free rates, kept between calls; `tolerance`: error of a step, relative to
    each component or to FLOOR. A step whose stages leave the domain of the equations is retried with a shorter length,
    until it succeeds or is so short that the boundary is reached: y is then just inside the boundary, and the status
    identifies the boundary.
    """
    k, new, trial = np.empty((7, SIZE)), np.empty(SIZE), x.copy()
    status = rates(y, control, x, c, k[0])
    if status != FINE:
        return status, step, 0, 0.0
    done, steps = 0.0, 0
    while done < span:
        last = done + step >= span * (1.0 - 1e-12)
        h = span - done if last else step
        trial[:] = x
        status = FINE
        for stage in range(1, 7):
            for i in range(SIZE):
                total = 0.0
                for j in range(stage):
                    total += NODES[stage, j] * k[j, i]
                new[i] = y[i] + h * total
            status = rates(new, control, trial, c, k[stage])
            if status != FINE:
                break
        if status != FINE:
            step = 0.25 * h
            if step < SMALLEST:
                return status, step, steps, done
            continue
        error = 0.0
        for i in range(SIZE):
            total = 0.0
            for j in range(7):
                total += ERROR[j] * k[j, i]
            error = max(error, abs(h * total) / (tolerance * max(abs(y[i]), abs(new[i]), FLOOR[i])))
        factor = min(5.0, max(0.2, 0.9 * error**-0.2)) if error > 0.0 else 5.0
        if error <= 1.0:
            done = span if last else done + h
            y[:] = new
            k[0] = k[6]
            x[:] = trial
            steps += 1
            step = max(step, h * factor) if last else h * factor
        else:
            step = h * min(factor, 1.0)
            if step < SMALLEST:
                return TOO_MANY_STEPS, step, steps, done
        if steps > most_steps:
            return TOO_MANY_STEPS, step, steps, done
    return FINE, step, steps, done
