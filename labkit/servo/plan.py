"""A plan of the cell's motion over the coming time steps, for an engine that runs the servo itself.

This is labkit.servo.correction.velocity_gradient with everything prepared that does not depend on the stress. The part
of the velocity gradient that the servo sets is, as six components in Mandel notation,

    x = K [(1 - a) P (b + d) - a limited(G (s - M sigma))]        G = g/(T dt) F (M C F)^-1        a = LOW_PASS

with sigma the stress, s the targets, b the symmetric velocity gradient so far, M, F and C the measured stresses, the
free rates and the stiffness of the cell, and g/T the gain over the steps between corrections; K is 1 for free
components and 0 for others. P = F F^+ and d, the prescribed rates, are needed only if some rates are both prescribed
and free, or if the servo keeps the volume.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.tensors import symmetric, to_six
from labkit.paths.control import Control
from labkit.paths.step import Step
from labkit.servo.correction import Servo, exact_gradient

AHEAD = 1000  # time steps, and rows, of Corrections at most, because labkit notices a signal only between Corrections


@dataclasses.dataclass(frozen=True)
class Correcting:
    """The servo of one step of a path, for one stiffness of the cell; k stresses are held.

    Args:
        measure: M, (k, 6).
        gain: G, (6, k), 1/(Pa s).
        project: P, (6, 6).
        held: K, (6,).
        limit: Limit of the rates, 1/s.
        isochoric: True to limit all rates by the same factor, and to add them to the prescribed ones before the
            exponential.
    """

    measure: np.ndarray
    gain: np.ndarray
    project: np.ndarray
    held: np.ndarray
    limit: float
    isochoric: bool

    @classmethod
    def of(cls, control: Control, limit: float, stiffness: np.ndarray, time_step: float, servo: Servo) -> Correcting:
        """Return the servo of a step.

        Args:
            control: Stresses to hold and rates that are free.
            limit: Limit of the rates, 1/s.
            stiffness: Stiffness of the cell, (c, c) for c components, Pa.
            time_step: Time step, s.
            servo: Gain, and interval between corrections.
        """
        n, free = control.components, control.free
        response = control.measure[:, :n] @ stiffness @ free[:n]
        gain = servo.gain / (servo.interval * time_step) * free @ np.linalg.inv(response)
        project = free @ np.linalg.pinv(free)
        return cls(control.measure, gain, project, free.any(axis=1).astype(float), limit, control.isochoric)


@dataclasses.dataclass(frozen=True)
class Corrections:
    """The coming time steps: one row per interval during which the velocity gradient is constant.

    Args:
        steps: Time steps of each interval, (n,).
        given: Prescribed rates of each interval, (n, 3, 3), 1/s.
        target: Stresses to hold, (n, k), Pa.
        gradient: Velocity gradient of the prescribed rates alone, (n, 3, 3), 1/s.
        servo: None if no stress is held.
        anew: True if the servo starts from rates of zero.
    """

    steps: np.ndarray
    given: np.ndarray
    target: np.ndarray
    gradient: np.ndarray
    servo: Correcting | None = None
    anew: bool = False

    @classmethod
    def constant(cls, steps: int, gradient: np.ndarray) -> Corrections:
        """Return the Corrections of steps with one velocity gradient (3, 3), 1/s."""
        rows = np.asarray(gradient, float)[None]
        return cls(np.array([steps]), np.zeros((1, 3, 3)), np.zeros((1, 0)), rows)

    @property
    def total(self) -> int:
        """Number of time steps."""
        return int(self.steps.sum())

    @property
    def shared(self) -> np.ndarray:
        """True (n,) where the rates so far must be projected on the free ones, because some are prescribed and free."""
        if self.servo is None:
            return np.zeros(len(self.steps), bool)
        both = to_six(symmetric(self.given))[:, self.servo.held > 0.0] != 0.0
        return both.any(axis=1) | self.servo.isochoric

    @property
    def exponential(self) -> np.ndarray:
        """True (n,) where the rates of the servo are added before the exponential, which keeps the volume."""
        isochoric = self.servo is not None and self.servo.isochoric
        return isochoric & (np.trace(self.given, axis1=1, axis2=2) == 0.0)


class Planner:
    """Collects the rows of Corrections."""

    def __init__(self, step: Step, rate: float, time_step: float) -> None:
        """Start without rows; `rate`, 1/s, multiplies the rates of the step."""
        self._step, self._rate, self._time_step = step, rate, time_step
        self._rows: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]] = []

    def add(self, steps: int, accumulated: float) -> None:
        """Add an interval that starts at this accumulated strain."""
        given = self._rate * self._step.rates(accumulated)
        target = np.zeros(0) if self._step.held is None else self._step.held.at(accumulated)
        self._rows.append((steps, given, target, exact_gradient(given, self._time_step)))

    def corrections(self, stiffness: np.ndarray | None, servo: Servo, anew: bool) -> Corrections:
        """Return the Corrections of the intervals so far; `stiffness` (Correcting.of) is None if no stress is held."""
        correcting = None
        if self._step.held is not None and stiffness is not None:
            limit = self._step.rate_limit * self._rate
            correcting = Correcting.of(self._step.held, limit, stiffness, self._time_step, servo)
        steps, given, target, gradient = map(np.array, zip(*self._rows, strict=True))
        return Corrections(steps, given, target, gradient, correcting, anew)
