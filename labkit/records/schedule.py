"""The schedule of a run: the time steps at which the path reverses and the run is recorded and saved."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from labkit.errors import InputError, require_type
from labkit.parameters import Number, check_parameters, parameter
from labkit.paths.path import Path, number_of_steps, require_consistent
from labkit.paths.rates import rate_of
from labkit.paths.step import Here
from labkit.quantities.conditions import condition
from labkit.servo.correction import STANDARD, Servo

LEAST_STEPS, MOST_STEPS = 100, 1e9  # smallest and largest number of time steps of a path
CHECKPOINT_WORK = 40_000_000  # grains x time steps between two checkpoints, if the engine names no other number
MOST_STOPS = 5_000  # stops between two checkpoints: a record takes about a millisecond
MOST_UNSAVED = 250e6  # bytes of snapshots, held in memory, between two checkpoints
SNAPSHOT_BYTES = 24 + 2.8 * 120  # bytes of a snapshot per grain


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of a run: what is recorded, how often the run is saved, and how stresses are controlled.

    If `guarded` is False, the time step and the energy balance do not stop a run, so that instability can be studied.
    """

    record_strain: Number[float | None] = parameter(
        None, above=0.0, high=1.0, help="axial strain between two records (default: the path's)"
    )
    snapshots: Number[int] = parameter(
        20, low=0, high=10**6, help="number of records stored with all contacts, in addition to the first; 0 for none"
    )
    save_every: Number[int | None] = parameter(
        None,
        low=1,
        high=10**9,
        kind=int,
        help="records between two saves (default: saved about every 5 s in fused, every 10 s in YADE)",
    )
    stop_when: str | None = parameter(
        None, kind=str, help="condition on recorded quantities that ends the run at a record, e.g. 'q/p > 0.9'"
    )
    inertial_number: Number[float | None] = parameter(
        None,
        above=0.0,
        high=0.1,
        help="inertial number to shear at, instead of at a fixed rate: e.g. 2e-4, because a specimen that dilates, or "
        "loses its mean stress between two records, exceeds it by up to 40 %",
    )
    servo: Servo = STANDARD
    guarded: bool = True

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)
        require_type(self.servo, Servo, "servo", "labkit.Servo()")
        if self.stop_when is not None:
            condition(self.stop_when)


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Time steps at which a path turns and a run is recorded and saved.

    A span is a step of the path with a given strain, or a sequence of consecutive steps that end at given stresses. A
    run stops at every multiple of `steps_per_record` and at the end of every span. At each stop the cell stiffness that
    the servo uses is recomputed. Each stop is recorded, except a regular stop less than half an interval before the end
    of a span, because the difference between the two records would be mostly noise. If steps of a path have their own
    intervals, these are counted from the start of the span.
    """

    turns: tuple[int, ...]  # time steps at which the spans end; the last one ends the path
    steps_per_record: int
    stops_per_checkpoint: int
    snapshots: int  # number of snapshots in addition to the first
    intervals: tuple[int, ...] = ()  # time steps between records in each span, if the path defines them
    firsts: tuple[int, ...] = (0,)  # index of the first step of the path in each span
    path_steps: int = 1  # number of steps of the path

    @classmethod
    def of(
        cls, path: Path, time_step: float, grains: int, options: Options, checkpoint_work: int = CHECKPOINT_WORK
    ) -> Schedule:
        """Return the schedule of a path with a rate, for a time step in s and a number of grains.

        Records are spaced at intervals of `record_strain` in axial strain, rounded to whole steps. Raises InputError if
        the path is inconsistent or the rate leads to too few or too many steps.
        """
        require_consistent(path)
        record_strain = options.record_strain or path.record_strain
        step_strain = rate_of(path) * time_step
        firsts, spans, intervals_of_steps = _spans(path, options.record_strain)
        steps = np.round(np.array(spans) / step_strain)
        if steps.min() < LEAST_STEPS or steps.sum() > MOST_STEPS:
            raise InputError(
                f"gives {steps.min():.3g} steps for the shortest step of the path and {steps.sum():.3g} for the whole "
                "path",
                field="rate",
                value=path.rate,
                allowed=f"a rate that gives {LEAST_STEPS} to {MOST_STEPS:g} steps",
            )
        steps = steps.astype(int)
        intervals = tuple[int, ...]()
        if not path.has_programmes:
            per_record = int(min(steps.min(), max(1, round(record_strain / step_strain))))
        else:
            intervals = tuple(
                int(min(n, max(1, round(x / step_strain)))) for n, x in zip(steps, intervals_of_steps, strict=True)
            )
            per_record = max(1, round(float(steps.sum()) / float((steps / intervals).sum())))  # mean over the path
        return cls(
            turns=tuple(int(x) for x in np.cumsum(steps)),
            steps_per_record=per_record,
            stops_per_checkpoint=options.save_every
            or _stops_per_checkpoint(steps.sum(), per_record, grains, options.snapshots, checkpoint_work),
            snapshots=options.snapshots,
            intervals=intervals,
            firsts=tuple(firsts),
            path_steps=number_of_steps(path),
        )

    @property
    def steps(self) -> int:
        """Number of steps of the whole path."""
        return self.turns[-1]

    @property
    def records(self) -> int:
        """Number of records after the first, if the path does not stop early."""
        return self._stops(self.steps) - self._unrecorded_stops

    def next_stop(self, step: int) -> int:
        """Return the next multiple of the interval or the end of the span, whichever comes first."""
        span = self.span(step)
        start, interval = self._counting(span)
        return min(self.turns[span], start + ((step - start) // interval + 1) * interval)

    def is_record(self, step: int) -> bool:
        """Return True if the stop at this step is recorded."""
        if step == 0 or step in self.turns:
            return True
        span = self.span(step)
        distance = min(step - self.start_of(span), self.turns[span] - step)
        return 2 * distance >= self._counting(span)[1]

    def is_close_to_record(self, step: int) -> bool:
        """Return True if the last stop is regular, recorded and less than half an interval before this step.

        False if this step is itself a stop.
        """
        start, interval = self._counting(self.span(step))
        last = start + (step - start) // interval * interval
        turned = max((turn for turn in self.turns if turn <= step), default=0)
        return turned < last < step and self.is_record(last) and 2 * (step - last) < interval

    def is_snapshot(self, record: int, last: bool) -> bool:
        """Return True if a record is stored with all contacts: the first, the last and evenly spaced ones between them.

        `record` is the index of the record; `last` is True if it ends the path.
        """
        if self.snapshots == 0:
            return False
        number = min(self.snapshots, self.records)
        nearest = _round_ratio(record * number, self.records)
        return last or record == _round_ratio(nearest * self.records, number)

    def is_checkpoint(self, step: int, last: bool) -> bool:
        """Return True if the stop at this step is a checkpoint; `last` is True if the stop ends the path."""
        return last or self._stops(step) % self.stops_per_checkpoint == 0

    def span(self, step: int) -> int:
        """Return the index of the span to which the motion of this time step belongs."""
        return int(np.searchsorted(self.turns, step, side="right"))

    def start_of(self, span: int) -> int:
        """Return the time step at which a span starts."""
        return self.turns[span - 1] if span else 0

    def span_of(self, number: int) -> int:
        """Return the index of the span that contains a step of the path."""
        return int(np.searchsorted(self.firsts, number, side="right")) - 1

    def _counting(self, span: int) -> tuple[int, int]:
        """Return the time step from which the regular stops of a span are counted, and the steps between them."""
        return (self.start_of(span), self.intervals[span]) if self.intervals else (0, self.steps_per_record)

    def _stops(self, step: int) -> int:
        """Return the number of stops up to this step, excluding the start."""
        if self.intervals:
            span = self.span(step)
            start, interval = self._counting(span) if span < len(self.turns) else (step, 1)
            return self._stops_before[span] + (step - start) // interval
        irregular = sum(turn <= step and turn % self.steps_per_record > 0 for turn in self.turns)
        return step // self.steps_per_record + irregular

    @functools.cached_property
    def _stops_before(self) -> tuple[int, ...]:
        """Number of stops up to the start of each span and the end of the path, if spans have their own intervals."""
        each = [-(-(turn - self.start_of(k)) // self.intervals[k]) for k, turn in enumerate(self.turns)]
        return tuple(int(total) for total in np.cumsum([0, *each]))

    @functools.cached_property
    def _unrecorded_stops(self) -> int:
        """Number of regular stops that are not recorded, because the end of a span is near."""
        near: set[int] = set()
        for span, turn in enumerate(self.turns):
            start, interval = self._counting(span)
            before = start + (turn - start) // interval * interval
            near |= {before} if self.intervals else {before, min(before + interval, self.steps)}
        return sum(not self.is_record(step) for step in near)


def _spans(path: Path, record_strain: float | None) -> tuple[list[int], list[float], list[float]]:
    """Return, for each span: the first step, the accumulated strain, and the strain between two records."""
    firsts, spans, intervals_of_steps = list[int](), list[float](), list[float]()
    by_stress = False
    for number, step in enumerate(path.steps_from(Here())):
        if not (by_stress and step.length is None):
            firsts.append(number)
            spans.append(step.limit)
            intervals_of_steps += (
                [] if step.programme is None else [step.programme.interval(record_strain, path.record_strain)]
            )
        by_stress = step.length is None
    return firsts, spans, intervals_of_steps


def _stops_per_checkpoint(steps: int, per_record: int, grains: int, snapshots: int, work: int) -> int:
    """Return the number of stops between two checkpoints, limited by the work and the memory between them."""
    usual = max(1, round(work / (grains * per_record)))
    share = min(1.0, snapshots * per_record / steps)  # fraction of the records that are snapshots
    fit = int(MOST_UNSAVED / (share * grains * SNAPSHOT_BYTES)) if share else MOST_STOPS
    return max(1, min(usual, MOST_STOPS, fit))


def _round_ratio(numerator: int, denominator: int) -> int:
    """Return the integer nearest to numerator/denominator, both positive; halves are rounded up."""
    return (2 * numerator + denominator) // (2 * denominator)
