"""The schedule of a run: at which steps the path reverses and the run is recorded and saved."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.dem.paths import Path
from labkit.dem.servo import STANDARD, Servo
from labkit.errors import InputError
from labkit.parameters import check_parameters, parameter

LEAST_STEPS, MOST_STEPS = 100, 1e9  # of a path
CHECKPOINT_GRAIN_STEPS = 40_000_000  # between two saves: about 30 s of computing in YADE


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
        help="records between two saves (default: about 30 s of computing in YADE)",
    )
    servo: Servo = STANDARD
    guarded: bool = True

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Steps at which a path reverses and a run is recorded and saved.

    A run stops at every multiple of `steps_per_record` and at every reversal. Each stop refreshes the cell stiffness of
    the servo. Each stop is recorded, except a regular one less than half an interval from a reversal or the end, where
    the difference between the two records would be mostly noise.
    """

    turns: tuple[int, ...]  # steps at which the path reverses; the last one ends it
    sign: float  # of the strain rate before the first turn
    steps_per_record: int
    stops_per_save: int
    snapshots: int  # in addition to the first

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
        per_record = int(min(steps.min(), max(1, round(record_strain / step_strain))))
        return cls(
            turns=tuple(int(x) for x in np.cumsum(steps)),
            sign=1.0 if legs[0] > 0.0 else -1.0,
            steps_per_record=per_record,
            stops_per_save=options.save_every or max(1, round(CHECKPOINT_GRAIN_STEPS / (grains * per_record))),
            snapshots=options.snapshots,
        )

    @property
    def steps(self) -> int:
        """Number of steps of the whole path."""
        return self.turns[-1]

    @property
    def records(self) -> int:
        """Number of records after the first, if the path does not stop early."""
        near = {step for turn in self.turns for step in self._regular_around(turn) if not self.is_record(step)}
        return self._stops(self.steps) - len(near)

    def next_stop(self, step: int) -> int:
        """The next multiple of `steps_per_record` or the next reversal, whichever comes first."""
        return min(self.turns[self.leg(step)], (step // self.steps_per_record + 1) * self.steps_per_record)

    def is_record(self, step: int) -> bool:
        """True if the stop at this step is recorded."""
        if step == 0 or step in self.turns:
            return True
        leg = self.leg(step)
        distance = min(step - self.turns[leg - 1] if leg else step, self.turns[leg] - step)
        return 2 * distance >= self.steps_per_record

    def is_close_to_record(self, step: int) -> bool:
        """True if the latest stop is a recorded regular stop less than half an interval before this step.

        False if the run stops at this step itself.
        """
        last = step // self.steps_per_record * self.steps_per_record
        turned = max((turn for turn in self.turns if turn <= step), default=0)
        return turned < last < step and self.is_record(last) and 2 * (step - last) < self.steps_per_record

    def is_snapshot(self, record: int, last: bool) -> bool:
        """True if a record is stored with all contacts: the first, the last and others evenly spaced between them.

        record: its number, from 0; last: True if it ends the path.
        """
        if self.snapshots == 0:
            return False
        number = min(self.snapshots, self.records)
        nearest = _rounded(record * number, self.records)
        return last or record == _rounded(nearest * self.records, number)

    def is_save(self, step: int, last: bool) -> bool:
        """True if the file is saved at the stop at this step; `last`: True if it ends the path."""
        return last or self._stops(step) % self.stops_per_save == 0

    def leg(self, step: int) -> int:
        """Number of the leg to which the motion of this step belongs, if the path reverses at given strains."""
        return int(np.searchsorted(self.turns, step, side="right"))

    def _stops(self, step: int) -> int:
        """Number of stops up to this step, without the start."""
        irregular = sum(turn <= step and turn % self.steps_per_record > 0 for turn in self.turns)
        return step // self.steps_per_record + irregular

    def _regular_around(self, turn: int) -> tuple[int, ...]:
        """The last regular stop up to a reversal and the first one after it, within the path."""
        before = turn // self.steps_per_record * self.steps_per_record
        return tuple(step for step in (before, before + self.steps_per_record) if step <= self.steps)


def _rounded(numerator: int, denominator: int) -> int:
    """The integer nearest to numerator/denominator, both positive; halves are rounded up."""
    return (2 * numerator + denominator) // (2 * denominator)
