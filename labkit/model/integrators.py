"""Integrators with a common base class. `Adaptive` is the default; the others, apart from `Scipy`, use fixed steps.

An integrator advances the state vector of a Problem along a piece of a path without reversal, where the rates are
smooth except for the change of branch in Eqs. 31 and 32. A step that leaves the domain of the equations, or that does
not converge, raises PhysicsError stating where; nothing is clipped.
"""

from __future__ import annotations

import abc
import dataclasses
from typing import ClassVar

import numpy as np
import scipy.integrate
import scipy.linalg

from labkit.errors import InputError, PhysicsError
from labkit.micro.tensors import to_tensor
from labkit.model import rates as compiled_rates
from labkit.model.adaptive import FLOOR, advance
from labkit.model.parameters import Model
from labkit.model.rates import FINE, NO_CONVERGENCE, REASONS, SIZE, TOO_MANY_STEPS, Control


class Failure(PhysicsError):
    """A step that cannot be taken: status (labkit.model.rates), last valid y, and strain `travelled` in the piece."""

    def __init__(self, status: int, y: np.ndarray, travelled: float = 0.0) -> None:
        """The message gives the reason and the state y (27,)."""
        super().__init__(f"{REASONS[status]} (at e = {y[0]:.4g}, Z = {y[1]:.4g}, Lambda = {y[2]:.4g})")
        self.status = status
        self.y = y
        self.travelled = travelled


class Problem:
    """dy/dt = f(y) for a model under a control; `t` is the strain measure used by the path.

    The free rates x are kept as the initial guess of the next call; `calls` counts the evaluations.
    """

    def __init__(self, model: Model, control: Control) -> None:
        """The initial guess of the free rates is zero."""
        self.constants = model.constants
        self.control = control
        self.x = np.zeros(control.free.shape[1])
        self.calls = 0

    def rates(self, y: np.ndarray) -> np.ndarray:
        """f(y), shape (27,). Raises Failure where the equations are undefined."""
        out = np.empty(SIZE)
        self.calls += 1
        self._require(compiled_rates.rates(y, self.control, self.x, self.constants, out), y)
        return out

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """df/dy, shape (27, 27), by central differences. Raises Failure."""
        out = np.empty((SIZE, SIZE))
        self.calls += 2 * SIZE
        self._require(compiled_rates.jacobian(y, self.control, self.x, self.constants, out), y)
        return out

    def stress(self, y: np.ndarray) -> np.ndarray:
        """C0 at y, shape (3, 3), Pa."""
        return to_tensor(np.array(compiled_rates.stress_of(y, self.constants)))

    def outside(self, y: np.ndarray) -> int:
        """FINE, or the reason why the equations are undefined at y."""
        return compiled_rates.outside(y, self.constants)

    def _require(self, status: int, y: np.ndarray) -> None:
        if status != FINE:
            raise Failure(status, y)


class Integrator(abc.ABC):
    """Advances a state vector along a piece of a path."""

    @abc.abstractmethod
    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        """State vector (27,) after a strain of `span`; `y` (27,) is not modified. Raises Failure."""


class Adaptive(Integrator):
    """Dormand-Prince 5(4), compiled, with error control; the step length is kept from one piece to the next.

    tolerance: error of one step, relative to each component or to its FLOOR (labkit.model.adaptive).
    """

    def __init__(self, tolerance: float = 1e-6, most_steps: int = 100_000) -> None:
        """`most_steps`: limit within one piece. Raises InputError for a tolerance outside 1e-13 to 0.1."""
        if not 1e-13 <= tolerance <= 1e-1:
            raise InputError(f"--tolerance {tolerance:g} is not valid: give a number from 1e-13 to 0.1")
        self.tolerance = tolerance
        self.most_steps = most_steps
        self.step = 1e-4

    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        new = y.copy()
        status, step, steps, travelled = advance(
            new, float(span), self.step, problem.control, problem.x, problem.constants, self.tolerance, self.most_steps
        )
        problem.calls += 6 * steps + 1
        if status != FINE:
            raise Failure(status, new, travelled)
        self.step = step
        return new


class Scipy(Integrator):
    """A method of scipy.integrate.solve_ivp: RK45, DOP853, LSODA, Radau, BDF."""

    def __init__(self, method: str, tolerance: float = 1e-6) -> None:
        """`method`: name in scipy; `tolerance`: relative tolerance, and absolute tolerance in units of FLOOR."""
        self.method = method
        self.tolerance = tolerance

    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        jacobian = {"jac": lambda t, y: problem.jacobian(y)} if self.method in ("LSODA", "Radau", "BDF") else {}
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

    `order`: theoretical order of convergence.
    """

    length: float

    order: ClassVar[int]

    def __post_init__(self) -> None:
        """Raises InputError unless the length is positive."""
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise InputError(f"step {self.length:g} is not valid: give a positive strain")

    def advance(self, problem: Problem, y: np.ndarray, span: float) -> np.ndarray:
        steps = max(1, int(np.ceil(span / self.length * (1.0 - 1e-9))))
        h = span / steps
        for number in range(steps):
            y = self.step(problem, y, h)
            status = problem.outside(y)
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
        return scipy.linalg.lu_factor(np.eye(SIZE) - self.theta * h * problem.jacobian(y))

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
        factors = scipy.linalg.lu_factor(np.eye(SIZE) - gamma * h * problem.jacobian(y))
        k1 = scipy.linalg.lu_solve(factors, problem.rates(y))
        k2 = scipy.linalg.lu_solve(factors, problem.rates(y + h * k1) - 2.0 * k1)
        return y + h * (1.5 * k1 + 0.5 * k2)


class ExponentialEuler(FixedStep):
    """y + h phi(h J) f(y), phi(z) = (exp z - 1)/z: exact for linear equations, order two, unconditionally stable."""

    order = 2

    def step(self, problem: Problem, y: np.ndarray, h: float) -> np.ndarray:
        J, f = problem.jacobian(y), problem.rates(y)
        block = np.zeros((SIZE + 1, SIZE + 1))
        block[:SIZE, :SIZE], block[:SIZE, SIZE] = h * J, h * f
        return y + scipy.linalg.expm(block)[:SIZE, SIZE]


FIXED = (ForwardEuler, Heun, RungeKutta4, BackwardEuler, Trapezium, Rosenbrock, ExponentialEuler)
