"""The loading of grains between two stops of a run: prescribed rates, and the servo that holds stresses."""

from __future__ import annotations

import dataclasses
from collections.abc import Generator

import numpy as np

from labkit.engines.base import Request, carry_out
from labkit.paths.step import Step
from labkit.servo.correction import Servo
from labkit.servo.plan import Correcting, Corrections, correcting_of, corrections_of
from labkit.simulation.clock import PathClock
from labkit.simulation.stopping import Stopping
from labkit.specimens.ready import Answer

LISTEN = 50  # time steps between two checks for a signal or for the end of a path


@dataclasses.dataclass(eq=False)
class Loading:
    """Loads the grains: moves them and their cell.

    Args:
        clock: The clock of the run.
        rate: Strain rate at a pace of one, 1/s.
        time_step: Time step, s.
        servo: Gain, and interval between corrections.
        stopping: Says whether a signal stops the run at once.
        ahead: Number of time steps taken at once by an engine that runs the servo; 1 for any other engine.
        gradient: Velocity gradient (3, 3), 1/s.
    """

    clock: PathClock
    rate: float
    time_step: float
    servo: Servo
    stopping: Stopping
    ahead: int
    gradient: np.ndarray

    def advance(self, end: int, step: Step, stiffness: np.ndarray | None) -> Generator[Request, Answer, bool]:
        """Advance to the time step `end`; returns True, earlier, if a stress ends the step of the path.

        A signal may also end the advance early. `stiffness` is the stiffness of the cell, Pa, if stresses are held.
        """
        follows = self.ahead > 1 and not step.stress_ends
        servo = correcting_of(step, self.clock.pace * self.rate, stiffness, self.time_step, self.servo)
        stress = None  # current stress, if it is known
        while self.clock.now < end and not self.stopping.at_once():
            corrections = self._plan(end, step, servo, self.ahead if follows else 1)
            self.gradient = yield from carry_out(corrections, self.time_step, self.gradient, follows, stress)
            if step.stress_ends:
                stress = yield lambda engine: engine.stress()
                if step.ends_at(stress):
                    return True
        return False

    def _plan(self, end: int, step: Step, servo: Correcting | None, most: int) -> Corrections:
        """Return the corrections of the coming `most` time steps or more, up to the time step `end`; move the clock."""
        clock, steps, accumulated = self.clock, list[int](), list[float]()
        last = min(end, clock.now + most)
        anew = (
            step.programme is not None and clock.planned_position == clock.origin
        )  # a new step may hold different stresses
        alike = step.programme is None and not callable(step.given) and not callable(getattr(step.held, "target", None))
        while clock.now < last:
            interval = self._interval(end, step)
            number = max(1, (last - clock.now) // interval) if alike else 1
            steps += [interval] * number
            accumulated.append(clock.accumulated_strain)
            clock.now += number * interval
        return corrections_of(step, clock.pace * self.rate, self.time_step, servo, steps, accumulated, anew)

    def _interval(self, end: int, step: Step) -> int:
        """Return the time steps to the next correction, but at most to `end` or to an abrupt change of the rates."""
        clock, feedback = self.clock, step.held is not None or step.length is None
        steps = min(self.servo.interval if feedback else LISTEN, end - clock.now)
        if step.programme is None:
            return steps
        strain = clock.pace * self.rate * self.time_step
        missing = (step.programme.next_change(clock.accumulated_strain) - clock.accumulated_strain) / strain
        return min(steps, max(1, round(missing))) if missing < clock.schedule.steps else steps
