"""The schedule of a run: at which steps the path reverses and the run is recorded and saved."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from labkit.dem.conditions import condition
from labkit.dem.paths import Path
from labkit.dem.servo import STANDARD, Servo
from labkit.errors import InputError
from labkit.parameters import check_parameters, parameter

LEAST_STEPS, MOST_STEPS = 100, 1e9  # of a path
CHECKPOINT_GRAIN_STEPS = 40_000_000  # between two points from which a run can be resumed: about 30 s in YADE
MOST_STOPS = 5_000  # between two of these points: a record takes about a millisecond
MOST_UNSAVED = 250e6  # bytes of snapshots between two of these points, which are in memory
SNAPSHOT_BYTES = 24 + 2.8 * 120  # per grain


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of a run: what is recorded, how often it is saved, and how stresses are controlled.

    If `guarded` is False, a run continues regardless of the time step and the energy balance; for studying instability.
    """

    record_strain: float | None = parameter(
        None, above=0.0, high=1.0, help="axial strain between two records (default: the path's)"
    )
    snapshots: int = parameter(
        20, low=0, high=10**6, help="number of records stored with all contacts, in addition to the first; 0 for none"
    )
    save_every: int | None = parameter(
        None,
        low=1,
        high=10**9,
        kind=int,
        help="records between two saves (default: saved about every 30 s in YADE, every 5 s in fused)",
    )
    stop_when: str | None = parameter(
        None, kind=str, help="condition on recorded quantities that ends the run at a record, e.g. 'q/p > 0.9'"
    )
    inertial_number: float | None = parameter(
        None, above=0.0, high=0.1, help="inertial number to shear at, e.g. 2.5e-4, instead of at a fixed rate"
    )
    servo: Servo = STANDARD
    guarded: bool = True

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)
        if self.stop_when is not None:
            condition(self.stop_when)


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Steps at which a path reverses and a run is recorded and saved.

    A run stops at every multiple of `steps_per_record` and at every reversal. Each stop refreshes the cell stiffness of
    the servo. Each stop is recorded, except a regular one less than half an interval from a reversal or the end, where
    the difference between the two records would be mostly noise. A path may have its own interval in each leg, which is
    then counted from the start of the leg.
    """

    turns: tuple[int, ...]  # steps at which the path reverses; the last one ends it
    sign: float  # of the strain rate before the first turn
    steps_per_record: int
    stops_per_checkpoint: int
    snapshots: int  # in addition to the first
    intervals: tuple[int, ...] = ()  # steps between records in each leg, if the path has its own

    @classmethod
    def of(cls, path: Path, time_step: float, grains: int, options: Options) -> Schedule:
        """The schedule of a path with an axial rate, for a time step in s and a number of grains.

        Records are spaced at intervals of `record_strain` in axial strain, rounded to whole steps. Raises InputError if
        the path is inconsistent or the rate gives too few or too many steps.
        """
        path.require_consistent()
        record_strain = options.record_strain or path.record_strain
        step_strain = path.axial_rate * time_step
        legs = np.diff((0.0, *path.turning_points()))
        steps = np.round(np.abs(legs) / step_strain)
        if steps.min() < LEAST_STEPS or steps.sum() > MOST_STEPS:
            raise InputError(
                f"gives {steps.min():.3g} steps for the shortest leg of the path and {steps.sum():.3g} for the whole "
                "path",
                field="rate",
                value=path.rate,
                allowed=f"a rate that gives {LEAST_STEPS} to {MOST_STEPS:g} steps",
            )
        steps = steps.astype(int)
        own, intervals = path.record_lengths(options.record_strain), tuple[int, ...]()
        if own is None:
            per_record = int(min(steps.min(), max(1, round(record_strain / step_strain))))
        else:
            intervals = tuple(int(min(n, max(1, round(x / step_strain)))) for n, x in zip(steps, own, strict=True))
            per_record = max(1, round(float(steps.sum()) / float((steps / intervals).sum())))  # the mean
        return cls(
            turns=tuple(int(x) for x in np.cumsum(steps)),
            sign=1.0 if legs[0] > 0.0 else -1.0,
            steps_per_record=per_record,
            stops_per_checkpoint=options.save_every or _stops_per_checkpoint(steps.sum(), per_record, grains, options),
            snapshots=options.snapshots,
            intervals=intervals,
        )

    @property
    def steps(self) -> int:
        """Number of steps of the whole path."""
        return self.turns[-1]

    @property
    def records(self) -> int:
        """Number of records after the first, if the path does not stop early."""
        return self._stops(self.steps) - self._unrecorded

    def next_stop(self, step: int) -> int:
        """The next multiple of the interval or the next reversal, whichever comes first."""
        leg = self.leg(step)
        start, interval = self._counting(leg)
        return min(self.turns[leg], start + ((step - start) // interval + 1) * interval)

    def is_record(self, step: int) -> bool:
        """True if the stop at this step is recorded."""
        if step == 0 or step in self.turns:
            return True
        leg = self.leg(step)
        distance = min(step - self.leg_start(leg), self.turns[leg] - step)
        return 2 * distance >= self._counting(leg)[1]

    def is_close_to_record(self, step: int) -> bool:
        """True if the latest stop is a recorded regular stop less than half an interval before this step.

        False if the run stops at this step itself.
        """
        start, interval = self._counting(self.leg(step))
        last = start + (step - start) // interval * interval
        turned = max((turn for turn in self.turns if turn <= step), default=0)
        return turned < last < step and self.is_record(last) and 2 * (step - last) < interval

    def is_snapshot(self, record: int, last: bool) -> bool:
        """True if a record is stored with all contacts: the first, the last and others evenly spaced between them.

        record: its number, from 0; last: True if it ends the path.
        """
        if self.snapshots == 0:
            return False
        number = min(self.snapshots, self.records)
        nearest = _rounded(record * number, self.records)
        return last or record == _rounded(nearest * self.records, number)

    def is_checkpoint(self, step: int, last: bool) -> bool:
        """True if the run can be resumed from the stop at this step; `last`: True if it ends the path."""
        return last or self._stops(step) % self.stops_per_checkpoint == 0

    def leg(self, step: int) -> int:
        """Number of the leg to which the motion of this step belongs, if the path reverses at given strains."""
        return int(np.searchsorted(self.turns, step, side="right"))

    def leg_start(self, leg: int) -> int:
        """The step at which a leg starts."""
        return self.turns[leg - 1] if leg else 0

    def span(self, leg: int) -> tuple[int, int]:
        """The steps at which a leg starts and ends."""
        return self.leg_start(leg), self.turns[leg]

    def _counting(self, leg: int) -> tuple[int, int]:
        """The step from which the regular stops of a leg are counted, and the steps between them."""
        return (self.leg_start(leg), self.intervals[leg]) if self.intervals else (0, self.steps_per_record)

    def _stops(self, step: int) -> int:
        """Number of stops up to this step, without the start."""
        if self.intervals:
            leg = self.leg(step)
            start, interval = self._counting(leg) if leg < len(self.turns) else (step, 1)
            return self._stops_before[leg] + (step - start) // interval
        irregular = sum(turn <= step and turn % self.steps_per_record > 0 for turn in self.turns)
        return step // self.steps_per_record + irregular

    @functools.cached_property
    def _stops_before(self) -> tuple[int, ...]:
        """Number of stops up to the start of each leg and up to the end of the path, if legs have their intervals."""
        each = [-(-(turn - self.leg_start(k)) // self.intervals[k]) for k, turn in enumerate(self.turns)]
        return tuple(int(total) for total in np.cumsum([0, *each]))

    @functools.cached_property
    def _unrecorded(self) -> int:
        """Number of regular stops that are not recorded because a reversal is near."""
        near: set[int] = set()
        for leg, turn in enumerate(self.turns):
            start, interval = self._counting(leg)
            before = start + (turn - start) // interval * interval
            near |= {before} if self.intervals else {before, min(before + interval, self.steps)}
        return sum(not self.is_record(step) for step in near)


def _stops_per_checkpoint(steps: int, per_record: int, grains: int, options: Options) -> int:
    """Stops between two points from which a run of this many steps can be resumed: bounded in work and in memory."""
    usual = max(1, round(CHECKPOINT_GRAIN_STEPS / (grains * per_record)))
    kept = min(1.0, options.snapshots * per_record / steps)  # share of the records that are snapshots
    fit = int(MOST_UNSAVED / (kept * grains * SNAPSHOT_BYTES)) if kept else MOST_STOPS
    return max(1, min(usual, MOST_STOPS, fit))


def _rounded(numerator: int, denominator: int) -> int:
    """The integer nearest to numerator/denominator, both positive; halves are rounded up."""
    return (2 * numerator + denominator) // (2 * denominator)
