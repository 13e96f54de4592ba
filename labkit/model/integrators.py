"""Integrators: a base class, and the adaptive one. benchmarks/integrators.py has others to compare it with.

An integrator advances the state vector of a Problem along a piece of a path without reversal, where the rates are
smooth except for the change of branch in Eqs. 31 and 32. A step that leaves the domain of the equations, or that does
not converge, raises PhysicsError stating where; nothing is clipped.
"""

from __future__ import annotations

import abc

import numpy as np

from labkit.errors import InputError, PhysicsError
from labkit.micro.tensors import to_tensor
from labkit.model import rates as compiled_rates
from labkit.model.adaptive import advance_adaptively
from labkit.model.parameters import Model
from labkit.model.rates import FINE, REASONS, SIZE, PointControl


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

    def __init__(self, model: Model, control: PointControl) -> None:
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
        status, step, steps, travelled = advance_adaptively(
            new, float(span), self.step, problem.control, problem.x, problem.constants, self.tolerance, self.most_steps
        )
        problem.calls += 6 * steps + 1
        if status != FINE:
            raise Failure(status, new, travelled)
        self.step = step
        return new
