"""The least-squares problem of a calibration: unknowns, predictions along the recorded strain, and residuals."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.optimize

from labkit.engines.kernel.tables import Pointers
from labkit.micro.tensors import to_six
from labkit.model.compiled import Pointer, Table, address, constants_at, entry, numbers_at
from labkit.model.constants import Constants
from labkit.model.integrators import Stretch, advance_adaptively
from labkit.model.parameters import FLOOR, MAY_BE_ZERO, Model
from labkit.model.rates import FINE, SIZE, WORK, PointControl, RateTask
from labkit.model.tensors import norm, put, six_at
from labkit.parameters import Values
from labkit.plugins.calibration.observation import Observation

NATURAL = np.array([0.1, 5e-4, 0.05, 0.05, 0.005])  # scale of the misfit of each variable in the first fit
AXIS = np.diag([-0.5, -0.5, 1.0])
TOLERANCE = 1e-7  # of the integration, well below the finite differences of the Jacobian
LEAST = 0.01  # smallest value of an exponent that may not be zero, divided by its initial value
PRIOR = 3.0  # width of a weak prior on each unknown, which bounds parameters that the data do not determine
MOST_EVALUATIONS = 100


def is_exponent(name: str) -> bool:
    """Return True for a parameter that is fitted directly, not as its logarithm, because it may be small."""
    return name.startswith(("gamma", "beta"))


def parameter_value(name: str, initial: float, u: float) -> float:
    """Return a parameter for its unknown u: initial exp(u), or initial (1 + u) for an exponent, but not below zero."""
    if is_exponent(name):
        least = 0.0 if name in MAY_BE_ZERO else LEAST * initial
        return float(max(initial * (1.0 + u), least))
    return float(initial * np.exp(np.clip(u, -20.0, 20.0)))


@dataclasses.dataclass(frozen=True)
class Residuals:
    """Residuals as a function of the unknowns x.

    The unknowns are one number per fitted parameter, zero at its initial value (`parameter_value`), followed by five
    per run: the offset of its initial state from its first record, in units of NATURAL. `names` are the fitted
    parameters, and `initial` holds the initial value of every parameter.
    """

    observations: Sequence[Observation]
    model: Model
    names: tuple[str, ...]
    initial: Mapping[str, float]

    def start(self) -> np.ndarray:
        """Return the unknowns at the start of a fit, all zero."""
        return np.zeros(len(self.names) + 5 * len(self.observations))

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return the value of every parameter at the unknowns x, name -> value."""
        fitted = zip(self.names, x, strict=False)  # the rest of x are the unknowns of the runs
        return {**self.initial} | {name: parameter_value(name, self.initial[name], u) for name, u in fitted}

    def constants(self, x: np.ndarray) -> Constants:
        """Return the constants of compiled code at the unknowns x."""
        values: Values = self.values(x)
        return self.model.constants._replace(**values)

    def predictions(self, x: np.ndarray, k: int, constants: Constants | None = None) -> np.ndarray:
        """Return the prediction (n, 5) for run k; pass the `constants` at x if they are already computed."""
        o, n = self.observations[k], len(self.names)
        offset = x[n + 5 * k : n + 5 * (k + 1)] * NATURAL
        first = o.values[0] + offset
        first[:2] = np.maximum(first[:2], (1.0, 1e-6))
        return predict(o, first, constants or self.constants(x))

    def residuals(self, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return the misfits of all runs divided by `weight` (5,), followed by the residuals of the prior."""
        constants = self.constants(x)
        blocks = [
            ((self.predictions(x, k, constants) - o.values) / weight).ravel() for k, o in enumerate(self.observations)
        ]
        return np.concatenate([*blocks, x[: len(self.names)] / PRIOR])

    def jacobian(self, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Differentiate `residuals` by forward differences; the initial state of a run affects only that run."""
        n, step = len(self.names), 1e-4
        base = [self.predictions(x, k) for k in range(len(self.observations))]
        sizes = [b.size for b in base]
        rows = np.concatenate([[0], np.cumsum(sizes)])
        J = np.zeros((rows[-1] + n, x.size))
        J[rows[-1] :, :n] = np.eye(n) / PRIOR
        for j in range(x.size):
            moved = x.copy()
            moved[j] += step
            constants = self.constants(moved)
            runs: Sequence[int] = range(len(base)) if j < n else [(j - n) // 5]
            for k in runs:
                change = (self.predictions(moved, k, constants) - base[k]) / (step * weight)
                J[rows[k] : rows[k + 1], j] = change.ravel()
        return J

    def solve(self, x: np.ndarray, weight: np.ndarray) -> Any:
        """Minimise the residuals from x; returns the result of scipy.optimize.least_squares."""
        return scipy.optimize.least_squares(
            self.residuals,
            x,
            self.jacobian,
            method="lm",
            args=(weight,),
            x_scale="jac",
            xtol=1e-5,
            ftol=1e-6,
            max_nfev=MOST_EVALUATIONS,
        )

    def misfit(self, x: np.ndarray) -> np.ndarray:
        """Return the RMS difference between prediction and observation, (runs, 5)."""
        return np.array(
            [
                np.sqrt(np.mean((self.predictions(x, k) - o.values) ** 2, axis=0))
                for k, o in enumerate(self.observations)
            ]
        )

    def sensitive(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names of parameters on which at least one record depends, and the remaining names."""
        n = len(self.names)
        J = self.jacobian(self.start(), NATURAL)[:-n, :n]
        size = np.sqrt((J**2).sum(axis=0))
        free = tuple(
            name for name, s in zip(self.names, size, strict=True) if s > 1.0 / PRIOR and self.initial[name] > 0.0
        )
        return free, tuple(name for name in self.names if name not in free)


def predict(observation: Observation, first: np.ndarray, constants: Constants) -> np.ndarray:
    """Predict the variables along the strain of an observation, from `first` (5,); returns (n, 5), zz components."""
    y = np.zeros(SIZE)
    y[0], y[1], y[2] = observation.e[0], first[0], first[1]
    for start, zz in zip((3, 9, 15), first[2:], strict=True):
        y[start : start + 6] = to_six(zz * AXIS)
    states = np.empty((len(observation.e), SIZE))
    follow_strain(y, observation.strain_step, constants, FLOOR, TOLERANCE, states)
    return states[:, (1, 2, 5, 11, 17)]


def follow_strain(
    y: np.ndarray, strain_step: np.ndarray, c: Constants, floor: np.ndarray, tolerance: float, states: np.ndarray
) -> int:
    """Integrate a law along given strain steps; returns its status.

    Where the domain of the equations ends, the last state is repeated.

    Args:
        y: First state.
        strain_step: Strain of each step, (n - 1, 6).
        c: Constants of the law.
        floor: ConstitutiveLaw.floor.
        tolerance: Relative error of a step.
        states: Receives the state at each record, (n, y.size).
    """
    states[0] = y
    steps = np.ascontiguousarray(strain_step)
    table = Pointers([np.empty(6), np.array(c, float), floor, np.empty((9, y.size)), np.empty(WORK)])
    return _follow_strain.of(type(c))(address(steps), address(states), table.address, tolerance, y.size, len(states))


@entry
def _follow_strain(strain_step: Pointer, states: Pointer, table: Table, tolerance: float, n: int, records: int) -> int:
    reached, steps = numbers_at(states, (records, n)), numbers_at(strain_step, (records - 1, 6))
    direction, nothing = numbers_at(table[0], 6), numbers_at(table[0], 0)
    control = PointControl(direction, numbers_at(table[0], (6, 0)), numbers_at(table[0], (0, 6)), nothing, 0.0)
    floor, stages, work = numbers_at(table[2], n), numbers_at(table[3], (9, n)), numbers_at(table[4], WORK)
    task = RateTask(control, nothing, constants_at(table[1]), floor, stages, work)
    status, step = FINE, 1e-4
    for k in range(records - 1):
        put(reached[k + 1], reached[k])
        size = norm(six_at(steps[k], 0))
        if size > 0.0 and status == FINE:
            for i in range(6):
                direction[i] = steps[k, i] / size
            status, step, _, _ = advance_adaptively(reached[k + 1], Stretch(size, step, tolerance, 10_000), task)
    return status
