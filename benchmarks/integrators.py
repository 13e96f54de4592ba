"""Integrators to compare with the model's own: methods of scipy, and explicit and implicit ones with fixed steps."""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import numpy as np
import scipy.integrate
import scipy.linalg

from labkit.errors import InputError
from labkit.model.compiled import Pointer, Table, entry, numbers_at
from labkit.model.integrators import FLOOR, Failure, Integrator, Problem
from labkit.model.rates import FINE, NO_CONVERGENCE, SIZE, TOO_MANY_STEPS, outside, rates, task_at
from labkit.model.tensors import put


def jacobian_of(problem: Problem, y: np.ndarray) -> np.ndarray:
    """d(dy/dt)/dy of a problem, shape (27, 27), by central differences. Raises Failure."""
    out = np.empty((SIZE, SIZE))
    problem.calls += 2 * SIZE
    status = problem.call(_jacobian, np.array(y, float), out)
    if status != FINE:
        raise Failure(status, y)
    return out


@entry
def _jacobian(y: Pointer, out: Pointer, table: Table, n: int, k: int) -> int:
    """Write the Jacobian to `out`; returns FINE, or the reason why it is undefined."""
    state, found, task = numbers_at(y, n), numbers_at(out, (SIZE, SIZE)), task_at(table, n, k)
    space, control, constants, room = task.stages, task.control, task.constants, task.work
    shifted, plus, minus, guess = space[0], space[1], space[2], space[3, :k]
    put(guess, task.x)
    put(shifted, state)
    for j in range(SIZE):
        step = 1e-6 * max(abs(state[j]), 1e-3 if j != 2 else 0.0)
        shifted[j] = state[j] + step
        status = rates(shifted, control, guess, constants, plus, room)
        if status != FINE:
            return status
        shifted[j] = state[j] - step
        status = rates(shifted, control, guess, constants, minus, room)
        if status != FINE:
            return status
        shifted[j] = state[j]
        for i in range(SIZE):
            found[i, j] = (plus[i] - minus[i]) / (2.0 * step)
    return FINE


class Scipy(Integrator):
    """A method of scipy.integrate.solve_ivp: RK45, DOP853, LSODA, Radau, BDF."""

    def __init__(self, method: str, tolerance: float = 1e-6) -> None:
        """Take scipy's name of the method, and the relative tolerance, also the absolute one in units of FLOOR."""
        self.method = method
        self.tolerance = tolerance

    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        jacobian = {"jac": lambda t, y: jacobian_of(problem, y)} if self.method in ("LSODA", "Radau", "BDF") else {}
        solution = scipy.integrate.solve_ivp(
            lambda t, y: problem.rates(y),
            (0.0, span),
            y,
            self.method,
            rtol=self.tolerance,
            atol=self.tolerance * FLOOR,
            t_eval=(span,),
            **jacobian,
        )
        if not solution.success:
            raise Failure(TOO_MANY_STEPS, y, solution.t[-1] if len(solution.t) else 0.0)
        return solution.y[:, -1]


@dataclasses.dataclass
class FixedStep(Integrator):
    """Equal strain steps, each no longer than `length`, that together span a piece of the path.

    `order` is the theoretical order of convergence.
    """

    length: float

    order: ClassVar[int]

    def __post_init__(self) -> None:
        """Raise InputError unless the length is positive."""
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise InputError(f"step {self.length:g} is not valid: give a positive strain")

    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        steps = max(1, int(np.ceil(span / self.length * (1.0 - 1e-9))))
        h = span / steps
        for number in range(steps):
            y = self.step(problem, y, h)
            status = outside(y, problem.law.constants)
            if status != FINE:
                raise Failure(status, y, number * h)
        return y

    @abc.abstractmethod
    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        """State vector after a step of strain `h`."""


class ForwardEuler(FixedStep):
    """y + h f(y)."""

    order = 1

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        return y + h * problem.rates(y)


class Heun(FixedStep):
    """The explicit trapezium rule, y + h/2 (k1 + k2) with k1 = f(y) and k2 = f(y + h k1)."""

    order = 2

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        k1 = problem.rates(y)
        return y + 0.5 * h * (k1 + problem.rates(y + h * k1))


class RungeKutta4(FixedStep):
    """The classical method of order four."""

    order = 4

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        k1 = problem.rates(y)
        k2 = problem.rates(y + 0.5 * h * k1)
        k3 = problem.rates(y + 0.5 * h * k2)
        k4 = problem.rates(y + h * k3)
        return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


class BackwardEuler(FixedStep):
    """y1 = y + h f(y1): damps stiff components. Newton with one Jacobian per step, recomputed if it stalls."""

    order = 1
    theta = 1.0  # weight of f at the end of the step
    iterations = 12

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        known = y + (1.0 - self.theta) * h * problem.rates(y) if self.theta < 1.0 else y
        new, before = y.copy(), np.inf
        factors = self._factors(problem, new, h)
        for _ in range(self.iterations):
            missing = known + self.theta * h * problem.rates(new) - new
            change = scipy.linalg.lu_solve(factors, missing)
            new = new + self._within(new, change)
            size = np.max(np.abs(change) / np.maximum(np.abs(new), FLOOR))
            if size < 1e-12:
                return new
            if size > 0.1 * before:
                factors = self._factors(problem, new, h)
            before = size
        if size < 1e-9:  # limited by rounding
            return new
        raise Failure(NO_CONVERGENCE, y)

    def _factors(self, problem, y, h):
        return scipy.linalg.lu_factor(np.eye(SIZE) - self.theta * h * jacobian_of(problem, y))

    @staticmethod
    def _within(y, change):
        """Newton's correction, shortened if it would make Z or Lambda zero; the solution is not affected."""
        shrink = max((-change[k] / (0.9 * y[k]) for k in (1, 2)), default=0.0)
        return change / max(1.0, shrink)


class Trapezium(BackwardEuler):
    """The implicit trapezium rule, y1 = y + h/2 (f(y) + f(y1))."""

    order = 2
    theta = 0.5


class Rosenbrock(FixedStep):
    """ROS2, the Rosenbrock method of two stages and order two, L-stable: one Jacobian and no iteration per step.

    Verwer, Spee, Blom and Hundsdorfer, SIAM J. Sci. Comput. 20 (1999) 1456-1480.

    (I - g h J) k1 = f(y);  (I - g h J) k2 = f(y + h k1) - 2 k1;  y1 = y + h (3/2 k1 + 1/2 k2);  g = 1 - 1/sqrt 2.
    """

    order = 2

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        gamma = 1.0 - np.sqrt(0.5)
        factors = scipy.linalg.lu_factor(np.eye(SIZE) - gamma * h * jacobian_of(problem, y))
        k1 = scipy.linalg.lu_solve(factors, problem.rates(y))
        k2 = scipy.linalg.lu_solve(factors, problem.rates(y + h * k1) - 2.0 * k1)
        return y + h * (1.5 * k1 + 0.5 * k2)


class ExponentialEuler(FixedStep):
    """y + h phi(h J) f(y), phi(z) = (exp z - 1)/z: exact for linear equations, order two, unconditionally stable."""

    order = 2

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        J, f = jacobian_of(problem, y), problem.rates(y)
        block = np.zeros((SIZE + 1, SIZE + 1))
        block[:SIZE, :SIZE], block[:SIZE, SIZE] = h * J, h * f
        return y + scipy.linalg.expm(block)[:SIZE, SIZE]


FIXED = (ForwardEuler, Heun, RungeKutta4, BackwardEuler, Trapezium, Rosenbrock, ExponentialEuler)
