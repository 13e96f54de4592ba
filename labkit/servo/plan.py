"""Velocity gradients of the coming time steps, from prescribed strain rates and from rates that the servo adjusts.

This module prepares everything that does not depend on the stress; labkit.servo.formula computes the rest, in this
process or in an engine. The part of the velocity gradient that the servo sets is, as six components in Mandel notation,

    x = K [(1 - a) P (b + d) - a limited(G (s - M sigma))]        G = g/(T dt) F (M C F)^-1        a = LOW_PASS

where sigma is the stress, s the targets, b the symmetric part of the current velocity gradient, and d the prescribed
rates. M selects the measured stresses and F the free rates; C is the stiffness of the cell, and g/T the gain divided by
the number of steps between corrections. K is 1 for free components and 0 for all others. P = F F^+ and d are needed
only if some rates are both prescribed and free, or if the servo preserves the volume.

With pore water (Control.water), s are total stresses, sigma + u I with u = K_w/n ln(V_0/V) replaces sigma, and
C + K_w/n I I replaces C. There is no low pass then: after a reversal it would compress the water for some corrections.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.paths.control import Control
from labkit.paths.path import Path
from labkit.paths.rates import rate_of
from labkit.paths.step import Here, Step
from labkit.servo.correction import STANDARD, Servo, exact_gradient
from labkit.servo.formula import ServoPlan, correct

# labkit reacts to signals only between Corrections, so these cover at most AHEAD steps, or about one second
LEAST_AHEAD, AHEAD, GRAIN_STEPS = 50, 1000, 20_000_000

BASIS = to_tensor(np.eye(6))  # orthonormal base tensors (6, 3, 3) of the Mandel notation
TRIANGULAR = np.triu(2.0 * BASIS) - BASIS * np.eye(3)  # the same strain rates with the spin of Control.triangular


@dataclasses.dataclass(frozen=True, eq=False)
class Correcting:
    """The servo in one step of a path, for one stiffness of the cell; rows and columns of stresses not held are 0.

    Args:
        measure: M, (6, 6).
        gain: G, (6, 6), in 1/(Pa s).
        project: P, (6, 6).
        held: K, (6,).
        limit: Limit of the rates (1/s).
        isochoric: True to limit all rates by the same factor, and to add them to the prescribed rates before the
            exponential is taken.
        triangular: True to add the spin that keeps the cell upper triangular.
        water: G M I K_w/n, (6,), in 1/s; None to hold effective stresses.
        volume: Volume of the cell (m3) at which the excess pore pressure is 0.
    """

    measure: np.ndarray
    gain: np.ndarray
    project: np.ndarray
    held: np.ndarray
    limit: float
    isochoric: bool
    triangular: bool = False
    water: np.ndarray | None = None
    volume: float = 1.0

    @classmethod
    def of(cls, control: Control, limit: float, stiffness: np.ndarray, time_step: float, servo: Servo) -> Correcting:
        """Return the servo of a step of a path.

        Args:
            control: Stresses to hold and rates that are free.
            limit: Limit of the rates (1/s).
            stiffness: Stiffness of the cell, (c, c) for c components, in Pa.
            time_step: Time step (s).
            servo: Gain and number of time steps between corrections.
        """
        n, free, water = control.components, control.free, control.water
        response = control.measure[:, :n] @ stiffness @ free[:n]
        if water is not None:
            response += water.stiffness * np.outer(control.share, free[:3].sum(axis=0))
        measure, gain = np.zeros((6, 6)), np.zeros((6, 6))
        measure[: len(response)] = control.measure
        gain[:, : len(response)] = servo.gain / (servo.interval * time_step) * free @ np.linalg.inv(response)
        is_held = free.any(axis=1).astype(float)
        fixed = measure, gain, control.project, is_held, limit, control.isochoric, control.triangular
        if water is None:
            return cls(*fixed)
        return cls(*fixed, water.stiffness * gain[:, : len(response)] @ control.share, water.volume)

    @functools.cached_property
    def sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`pull`, `kept` and `spread` of a ServoPlan."""
        flat, unchanged = BASIS.reshape(6, 9), np.zeros((3, 6, 3, 3))
        unchanged[0], unchanged[1] = BASIS, (self.project @ flat).reshape(BASIS.shape)
        spread = np.ascontiguousarray(np.moveaxis(TRIANGULAR if self.triangular else BASIS, 0, -1)) * self.held
        return (self.gain @ self.measure @ flat).reshape(BASIS.shape), unchanged, spread


IDLE = Correcting(np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6), 0.0, False)  # holds no stress


def correcting_of(
    step: Step, rate: float, stiffness: np.ndarray | None, time_step: float, servo: Servo
) -> Correcting | None:
    """Return the servo of a step of a path at a rate (1/s); None if the step holds no stress. See Correcting.of."""
    if step.held is None or stiffness is None:
        return None
    return Correcting.of(step.held, step.rate_limit * rate, stiffness, time_step, servo)


@dataclasses.dataclass(frozen=True, eq=False)
class Corrections:
    """The coming time steps: one row per interval during which the velocity gradient is constant.

    Args:
        steps: Time steps of each interval, (n,).
        given: Prescribed rates of each interval, (n, 3, 3), in 1/s.
        target: Stresses to hold, (n, 6), in Pa; 0 in the columns of stresses not held.
        gradient: Velocity gradient of the prescribed rates alone, (n, 3, 3), in 1/s.
        servo: The servo; None if no stress is held.
        anew: True if the servo starts again from rates of zero.
    """

    steps: np.ndarray
    given: np.ndarray
    target: np.ndarray
    gradient: np.ndarray
    servo: Correcting | None = None
    anew: bool = False

    @classmethod
    def constant(cls, steps: int, gradient: np.ndarray) -> Corrections:
        """Return the Corrections of a number of steps with a constant velocity gradient (3, 3), in 1/s."""
        rows = np.asarray(gradient, float)[None]
        return cls(np.array([steps]), np.zeros((1, 3, 3)), np.zeros((1, 6)), rows)

    @functools.cached_property
    def _prescribed_six(self) -> np.ndarray:
        """The prescribed rates in Mandel notation, (n, 6)."""
        return to_six(symmetric(self.given))

    @functools.cached_property
    def plan(self) -> ServoPlan:
        """The Corrections as arrays for the formula."""
        servo, both = self.servo or IDLE, self.is_projected
        memory = both.astype(np.int64)  # rates outside the space of free rates would change the volume
        if self.anew:
            memory[0] = 2
        water = np.zeros(6)
        if servo.water is not None:  # no low pass
            both, memory, water = np.zeros_like(both), np.full_like(memory, 2), servo.water
        pull, unchanged, spread = servo.sums
        return ServoPlan(
            steps=self.steps.astype(np.int64, copy=False),
            gradient=self.gradient,
            given=self.given,
            goal=self.target @ servo.gain.T - water * math.log(servo.volume),
            shared=self._prescribed_six @ servo.project.T * both[:, None],
            memory=memory,
            exponential=self.exponential.astype(np.int64),
            controlled=int(self.servo is not None),
            isochoric=int(servo.isochoric),
            limit=float(servo.limit),
            pull=pull,
            water=water,
            kept=unchanged,
            spread=spread,
        )

    def velocity_gradient(
        self, row: int, time_step: float, stress: np.ndarray | None, before: np.ndarray, volume: float = 1.0
    ) -> np.ndarray:
        """Return the velocity gradient (3, 3), in 1/s, of an interval.

        Args:
            row: Index of the interval.
            time_step: Time step (s).
            stress: Current stress, (3, 3), in Pa, if a stress is held.
            before: Current velocity gradient, (3, 3), in 1/s.
            volume: Volume of the cell (m3), read if there is water in the pores.
        """
        wanted = self.gradient[row].copy()
        if self.servo is not None and stress is not None:
            memory = np.zeros((2, 6)), np.zeros((3, 3, 3))
            correct(self.plan, row, -volume * np.ravel(stress), volume, time_step, before, wanted, memory)
        return wanted

    @property
    def is_projected(self) -> np.ndarray:
        """Mask (n,), True where the current rates must be projected onto the free rates (P in the module docstring)."""
        if self.servo is None:
            return np.zeros(len(self.steps), bool)
        both = self._prescribed_six[:, self.servo.held > 0.0] != 0.0
        return both.any(axis=1) | self.servo.isochoric

    @property
    def exponential(self) -> np.ndarray:
        """Mask (n,), True where the servo's rates are added before the exponential, which preserves the volume."""
        isochoric = self.servo is not None and self.servo.isochoric
        return isochoric & (np.trace(self.given, axis1=1, axis2=2) == 0.0)


def ahead(grains: int) -> int:
    """Return the number of time steps that Corrections cover for a number of grains."""
    return int(np.clip(GRAIN_STEPS // grains, LEAST_AHEAD, AHEAD))


def corrections_of(
    step: Step,
    rate: float,
    time_step: float,
    servo: Correcting | None,
    steps: Sequence[int],
    accumulated: Sequence[float],
    anew: bool = False,
) -> Corrections:
    """Return the Corrections for some intervals of a step of a path.

    Args:
        step: The step.
        rate: Strain rate (1/s) by which the rates of the step are multiplied.
        time_step: Time step (s).
        servo: Servo of the step, from `correcting_of`.
        steps: Time steps of each interval, (n,).
        accumulated: Accumulated strain at the start of each interval, (n,); if neither rates nor targets depend on it,
            one value suffices.
        anew: See Corrections.
    """
    prescribed, gradient, target = np.empty((len(steps), 3, 3)), np.empty((len(steps), 3, 3)), np.zeros((len(steps), 6))
    rates = np.array([rate * step.rates(at) for at in (accumulated if callable(step.given) else accumulated[:1])])
    changes = np.ones(len(rates), bool)
    changes[1:] = (rates[1:] != rates[:-1]).any(axis=(1, 2))
    prescribed[:] = rates
    gradient[:] = np.array([exact_gradient(velocity, time_step) for velocity in rates[changes]])[np.cumsum(changes) - 1]
    if step.held is not None:
        targets = [step.held.at(at) for at in (accumulated if callable(step.held.target) else accumulated[:1])]
        target[:, : len(targets[0])] = targets
    return Corrections(np.array(steps), prescribed, target, gradient, servo, anew)


def prescribed_gradient(path: Path, time_step: float) -> np.ndarray:
    """Return the velocity gradient L (3, 3), in 1/s, at the start of a path whose strain rates are all prescribed."""
    step = next(iter(path.steps_from(Here())))
    return velocity_gradient(step, rate_of(path), time_step)


def velocity_gradient(
    step: Step,
    rate: float,
    time_step: float,
    stress: np.ndarray | None = None,
    stiffness: np.ndarray | None = None,
    before: np.ndarray | None = None,
    accumulated: float = 0.0,
) -> np.ndarray:
    """Return the velocity gradient L (3, 3), in 1/s, of a step until the servo's next correction.

    With prescribed rates G, L satisfies 1 + L dt = exp(-G dt) in every time step: the cell follows the logarithmic
    strains exactly, and an isochoric rate preserves the volume. Prescribed rates and targets may depend on the
    accumulated strain. Raises InputError if the step holds stresses and one of the three arguments from `stress` on is
    missing.

    Args:
        step: The step of a path.
        rate: Strain rate (1/s) by which the rates of the step are multiplied.
        time_step: Time step (s).
        stress: Current stress, (3, 3), in Pa, for a step that holds stresses.
        stiffness: Stiffness of the cell, (c, c), in Pa, for the c components of the Control of the step.
        before: Current velocity gradient, (3, 3), in 1/s.
        accumulated: Accumulated strain.
    """
    if step.held is not None and (stress is None or stiffness is None or before is None):
        raise InputError("the step controls a stress: give `stress`, `stiffness` and `before`")
    so_far = np.zeros((3, 3)) if before is None else before
    correcting = correcting_of(step, rate, stiffness, time_step, STANDARD)
    corrections = corrections_of(step, rate, time_step, correcting, [STANDARD.interval], [accumulated])
    return corrections.velocity_gradient(0, time_step, stress, so_far)
