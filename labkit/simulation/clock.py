"""The clock of a run: the number of time steps computed so far, and the corresponding planned time step."""

from __future__ import annotations

import dataclasses
import math

from labkit.records.schedule import Schedule


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
        """Accumulated strain of the path, or of the current phase on a path of phases."""
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
