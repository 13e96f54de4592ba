"""The clock of a run: the number of time steps computed so far, and the corresponding planned time step.

The two differ in a run with a prescribed inertial number I = |D'| D sqrt(rho/p) (section 2), which is proportional to
the strain rate. Its pace is its strain rate, divided by the rate of its path. At each stop the mean stress determines
the pace up to the next stop, so a resumed run takes the same steps. The stops are the same as at a pace of one, and the
pace is constant between two stops.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from labkit.errors import InputError
from labkit.files.schema import Variable
from labkit.grains.scene import Scene
from labkit.parameters import parameters_of
from labkit.paths.path import Path
from labkit.records.limits import LEAST, MOST, expected_inertial_number
from labkit.records.schedule import Options, Schedule


@dataclasses.dataclass
class PathClock:
    """Time steps of a run: the number computed, and the corresponding number of planned time steps in its Schedule.

    The two differ if the pace of the run is not one, or if a step of its path ended early.

    Args:
        schedule: The planned time steps.
        now: Number of time steps computed so far.
        stop: Time step of the last stop.
        skipped: Number of planned time steps minus the number computed, at the last stop.
        step_strain: Accumulated strain of a planned time step.
        pace: Planned time steps in one time step since the last stop.
        span: Current span of the schedule; None before the first span.
        origin: Planned time step from which the accumulated strain is counted.
    """

    schedule: Schedule
    now: int
    stop: int
    skipped: int
    step_strain: float
    pace: float = 1.0
    span: int | None = None
    origin: int = 0

    @property
    def planned_position(self) -> float:
        """The planned time step; it is a whole number at every stop."""
        moved = self.now - self.stop
        return self.stop + self.skipped + (self.pace * moved if moved else 0)

    @property
    def planned_step(self) -> int:
        """The planned time step of a stop."""
        return round(self.planned_position)

    @property
    def accumulated_strain(self) -> float:
        """Accumulated strain of the path, or of the current step if the steps have programmes."""
        return self.step_strain * (self.planned_position - self.origin)

    @property
    def is_at_end_of_span(self) -> bool:
        """True if the planned time steps of the span have been made."""
        return self.span is not None and self.planned_position == self.schedule.turns[self.span]

    def enter(self, span: int, counts_anew: bool) -> None:
        """Enter a span, skipping the remaining planned time steps of the previous span.

        Args:
            span: Index of the span.
            counts_anew: True to count the accumulated strain from the start of the span.
        """
        if self.span is not None and span != self.span:
            self.skipped += self.schedule.turns[self.span] - self.planned_step
        self.span, self.pace = span, 1.0
        self.origin = self.schedule.start_of(span) if counts_anew else 0

    def halt(self) -> None:
        """Record a stop at the current time step."""
        self.skipped, self.stop = self.planned_step - self.now, self.now

    def halt_early(self) -> None:
        """Record that a run is interrupted between two stops; the next one stays ahead."""
        self.skipped, self.stop = math.floor(self.planned_position) - self.now, self.now


ACCUMULATED = {
    "accumulated_strain": Variable("accumulated_strain", ("time",), "f8", "1", "integral of the axial strain rate")
}  # recorded, because it is not proportional to the time


def pace(number: float, expected: float) -> float:
    """Return the pace at which the inertial number is `number`, if `expected` is that at a pace of 1.

    The pace is limited to 0.1 to 10. It is 1 while all strain rates are zero or set by the servo.
    """
    return float(np.clip(number / expected, LEAST, MOST)) if expected > 0.0 else 1.0


def steps_at(wanted: float, planned: float) -> tuple[int, float]:
    """Return a whole number of time steps that replace `planned` ones, at most at the pace `wanted`, and their pace."""
    steps = max(1, math.ceil(planned / wanted))
    return steps, planned / steps


def expected_pace(path: Path, options: Options, scene: Scene, pressure: float) -> float:
    """Return the pace at the start of a path with an axial rate, at a mean stress of `pressure`, Pa."""
    if options.inertial_number is None:
        return 1.0
    return pace(options.inertial_number, expected_inertial_number(path, scene, pressure))


def require_one_rate(path: Path, options: Options) -> None:
    """Raise InputError if a run has both an inertial number and a rate; a default rate is treated as no rate."""
    has_rate = path.rate is not None and path.rate != parameters_of(type(path))["rate"].default
    if has_rate and options.inertial_number is not None:
        problem = "excludes a fixed rate"
        allowed = "one of the two, and leave the other out"
        raise InputError(problem, field="inertial_number", value=options.inertial_number, allowed=allowed)
