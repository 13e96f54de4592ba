"""The base class of integrators, and the adaptive integrator; benchmarks/integrators.py has others for comparison.

The default is the Dormand-Prince 5(4) pair, compiled as one loop: Dormand and Prince, A family of embedded Runge-Kutta
formulae, J. Comput. Appl. Math. 6 (1980) 19-26.

An integrator advances the state vector of a Problem along a stretch of a path without reversal, where the rates are
smooth except for the change of branch in Eqs. 31 and 32. A step that leaves the domain of the equations, or that does
not converge, raises PhysicsError stating where; nothing is clipped.
"""

from __future__ import annotations

import abc
from typing import NamedTuple

import numpy as np

from labkit.engines.kernel.tables import Pointers
from labkit.errors import InputError, PhysicsError
from labkit.model.compiled import CompiledEntry, Pointer, Table, address, always_inline, entry, numbers_at
from labkit.model.law import ConstitutiveLaw, law_settle
from labkit.model.parameters import FLOOR as FLOOR
from labkit.model.parameters import Model
from labkit.model.rates import FINE, REASONS, TOO_MANY_STEPS, WORK, PointControl, RateTask, rates, rates_at, task_at
from labkit.model.tensors import put

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
MOST_STEPS = 100_000  # largest number of steps in one stretch
SMALLEST = 1e-13  # a step (strain, or fraction of an increment) below this size means that a boundary is reached


class Failure(PhysicsError):
    """A step failed: its status (labkit.model.rates), the last valid y, and the strain accumulated in the stretch."""

    def __init__(
        self, status: int, y: np.ndarray, accumulated_strain: float = 0.0, names: tuple[str, ...] = Model.leading
    ) -> None:
        """Compose the message from the reason and the first variables of the state y, which are called `names`."""
        where = ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, y, strict=False))
        super().__init__(f"{REASONS[status]} (at {where})")
        self.status = status
        self.y = y
        self.accumulated_strain = accumulated_strain


class Problem:
    """dy/dt = f(y) for a law under a control; `t` is the strain measure used by the path.

    The free rates x are stored as the initial guess for the next call; `calls` counts the evaluations.
    """

    def __init__(self, law: ConstitutiveLaw, control: PointControl, floor: np.ndarray = FLOOR) -> None:
        """Set the initial guess of the free rates to zero; `floor` is the law's ConstitutiveLaw.floor."""
        self.law, self.floor = law, floor
        self.x = np.zeros(control.free.shape[1])
        self.calls = 0
        self._kind = type(law.constants)
        self._rest = law.numbers, floor, np.empty((9, floor.size)), np.empty(WORK)
        self.control = control

    @property
    def control(self) -> PointControl:
        """Control of the point; a new control must have the same number of free rates."""
        return self._control

    @control.setter
    def control(self, control: PointControl) -> None:
        """Pass the arrays of a new control to compiled code."""
        self._control = control
        arrays = (np.concatenate([control.given, [control.gain], control.target]), control.free, control.measure)
        self._table = Pointers([*(np.ascontiguousarray(array, float) for array in arrays), self.x, *self._rest])

    def call(self, entry: CompiledEntry, y: np.ndarray, other: np.ndarray) -> int:
        """Call an entry with the arguments of `rates_at`: a state y, another array, and the table of the problem."""
        if y.size > self.floor.size:
            raise ValueError(f"a state of {y.size} numbers, for a law of {self.floor.size}")
        return entry.of(self._kind)(address(y), address(other), self._table.address, y.size, self.x.size)

    def rates(self, y: np.ndarray) -> np.ndarray:
        """Return f(y), with the shape of y. Raises Failure where the equations are undefined."""
        out = np.empty(y.size)
        self.calls += 1
        status = self.call(rates_at, np.array(y, float), out)
        if status != FINE:
            raise Failure(status, y, 0.0, self.law.leading)
        return out

    def stress(self, y: np.ndarray) -> np.ndarray:
        """Stress at y, (3, 3), Pa."""
        return self.law.stress(y)


class Integrator(abc.ABC):
    """Advances a state vector along a stretch of a path."""

    @abc.abstractmethod
    def advance(self, problem: Problem, y: np.ndarray, length: float) -> np.ndarray:
        """Return the state vector after a strain of `length`; `y` is not modified.

        Raises Failure where the equations are undefined.
        """


class Adaptive(Integrator):
    """Dormand-Prince 5(4), compiled, with error control; each stretch starts with the step length of the last.

    Raises InputError for a tolerance outside 1e-13 to 0.1.

    Args:
        tolerance: Error of one step, relative to each component or to its floor.
    """

    def __init__(self, tolerance: float = 1e-6) -> None:
        """Check the tolerance."""
        if not 1e-13 <= tolerance <= 1e-1:
            raise InputError(f"--tolerance {tolerance:g} is not valid: give a number from 1e-13 to 0.1")
        self.tolerance = tolerance
        self.step = 1e-4

    def advance(self, problem: Problem, y: np.ndarray, length: float) -> np.ndarray:
        new, numbers = np.array(y, float), np.array((length, self.step, self.tolerance, MOST_STEPS, 0.0))
        status = problem.call(_advance, new, numbers)
        accumulated_strain, step, _, _, steps = numbers.tolist()
        problem.calls += 6 * int(steps) + 1
        if status != FINE:
            raise Failure(status, new, accumulated_strain, problem.law.leading)
        self.step = step
        return new


class Stretch(NamedTuple):
    """A stretch of a path, and the settings with which it is integrated.

    Args:
        length: Strain to cover.
        step: Initial step length.
        tolerance: Error of a step, relative to each component or to its floor.
        most_steps: Largest number of steps.
    """

    length: float
    step: float
    tolerance: float
    most_steps: float


def advance_adaptively(y: np.ndarray, stretch: Stretch, task: RateTask) -> tuple[int, float, int, float]:
    """Integrate y over a stretch in place. Returns (status, next step length, number of steps, strain covered).

    A step whose stages leave the domain of the equations is retried with a shorter length, until it succeeds or is so
    short that the boundary is reached: y is then just inside the boundary, and the status identifies the boundary.
    """
    k, new, trial = task.stages[:7], task.stages[7], task.stages[8, : task.x.size]
    step, done, steps = stretch.step, 0.0, 0
    status = rates(y, task.control, task.x, task.constants, k[0], task.work)
    while status == FINE and done < stretch.length:
        last = done + step >= stretch.length * (1.0 - 1e-12)
        h = stretch.length - done if last else step
        status = _try_step(y, h, task)
        if status != FINE:
            step = 0.25 * h
            if step >= SMALLEST:
                status = FINE
            continue
        error = _error_of(y, h, stretch.tolerance, task)
        factor = min(5.0, max(0.2, 0.9 * error**-0.2)) if error > 0.0 else 5.0
        if error <= 1.0:
            done = stretch.length if last else done + h
            put(y, new)
            put(k[0], k[6])
            law_settle(y, task.constants)
            put(task.x, trial)
            steps += 1
            step = max(step, h * factor) if last else h * factor
        else:
            step = h * min(factor, 1.0)
        if steps > stretch.most_steps or (error > 1.0 and step < SMALLEST):
            status = TOO_MANY_STEPS
    return status, step, steps, done


@always_inline
def _try_step(y, h, task):
    """Compute the stages of a step of length h; writes the result to stages[7] and the free rates to stages[8]."""
    k, new, trial = task.stages[:7], task.stages[7], task.stages[8, : task.x.size]
    put(trial, task.x)
    for stage in range(1, 7):
        for i in range(y.size):
            total = 0.0
            for j in range(stage):
                total += NODES[stage, j] * k[j, i]
            new[i] = y[i] + h * total
        status = rates(new, task.control, trial, task.constants, k[stage], task.work)
        if status != FINE:
            return status
    return FINE


@always_inline
def _error_of(y, h, tolerance, task):
    """Return the largest error of a component after _try_step, divided by `tolerance` times its size or its floor."""
    k, new, error = task.stages[:7], task.stages[7], 0.0
    for i in range(y.size):
        total = 0.0
        for j in range(7):
            total += ERROR[j] * k[j, i]
        error = max(error, abs(h * total) / (tolerance * max(abs(y[i]), abs(new[i]), task.floor[i])))
    return error


@entry
def _advance(y: Pointer, numbers: Pointer, table: Table, n: int, k: int) -> int:
    values = numbers_at(numbers, 5)  # a Stretch and the number of steps; the strain covered replaces the length
    stretch = Stretch(values[0], values[1], values[2], values[3])
    status, values[1], values[4], values[0] = advance_adaptively(numbers_at(y, n), stretch, task_at(table, n, k))
    return status
