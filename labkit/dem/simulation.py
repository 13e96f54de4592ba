"""Joins specimen, path, engine and recorder: one run, continued if it was begun."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path as File

import numpy as np

from labkit.dem import lattice
from labkit.dem.consolidation import consolidate, pressure_error
from labkit.dem.energy import opened, require_balanced
from labkit.dem.engine import Progress, Start, silent
from labkit.dem.measure import measure
from labkit.dem.paths import Path
from labkit.dem.recorder import Begun, Place, Recorder
from labkit.dem.servo import STANDARD, Servo, cell_stiffness, velocity_gradient
from labkit.dem.specimen import ready
from labkit.dem.state import State
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.interruption import Signals, stop_on_signals
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import mean_stress
from labkit.parameters import check_parameters, parameter

LEAST_STEPS, MOST_STEPS = 100, 1e9  # of a path
CHECKPOINT_GRAIN_STEPS = 40_000_000  # between two saves: half a minute of YADE
CONSOLIDATED = 2e-3  # of the pressure: nearer than this a specimen is not consolidated again
LISTEN = 50  # steps between two looks for a signal or for the end of a path


@dataclasses.dataclass(frozen=True)
class Options:
    """What is recorded of a run, how often it is saved, and how stresses are held.

    Not `guarded`, a run goes on whatever the time step and the energy balance are: for those who study what comes then.
    """

    record_strain: float | None = parameter(
        None, above=0.0, high=1.0, help="axial strain between two records (default: the path's)"
    )
    snapshots: int = parameter(
        20, low=0, high=10**6, help="records kept with all contacts beside the first; 0 for none"
    )
    save_every: int | None = parameter(
        None, low=1, high=10**9, kind=int, help="records between two saves (default: half a minute of YADE)"
    )
    servo: Servo = STANDARD
    guarded: bool = True

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Which steps turn the path, which are recorded, and which records are snapshots and saves."""

    turns: tuple[int, ...]  # steps at which the path turns; the last one ends it
    sign: float  # of the rate before the first turn
    steps_per_record: int
    records_per_snapshot: int
    records_per_save: int

    @classmethod
    def of(cls, path: Path, time_step: float, grains: int, options: Options) -> Schedule:
        """Records every `record_strain` of axial strain, the first and up to `snapshots` more with all contacts.

        Raises InputError when the rate fits neither the strain nor the time step.
        """
        path.require_consistent()
        record_strain = options.record_strain or path.record_strain
        step_strain = path.rate * time_step
        legs = np.diff((0.0, *path.turning_points()))
        steps = np.round(np.abs(legs) / step_strain)
        if steps.min() < LEAST_STEPS or steps.sum() > MOST_STEPS:
            raise InputError(
                f"makes {steps.min():.3g} steps of the shortest leg of the path and {steps.sum():.3g} of the whole",
                field="rate",
                value=path.rate,
                allowed=f"a rate that makes {LEAST_STEPS} to {MOST_STEPS:g} steps",
            )
        steps = steps.astype(int)
        sign = 1.0 if legs[0] > 0.0 else -1.0
        per_record = int(min(steps.min(), max(1, round(record_strain / step_strain))))
        records = -(-int(steps.sum()) // per_record)
        return cls(
            turns=tuple(int(x) for x in np.cumsum(steps)),
            sign=sign,
            steps_per_record=per_record,
            records_per_snapshot=-(-records // options.snapshots) if options.snapshots else 0,
            records_per_save=options.save_every or max(1, round(CHECKPOINT_GRAIN_STEPS / (grains * per_record))),
        )

    @property
    def steps(self) -> int:
        """Of the whole path."""
        return self.turns[-1]

    def leg(self, step: int) -> int:
        """Number of reversals by strain before this step."""
        return int(np.searchsorted(self.turns, step, side="right"))

    def next_record(self, step: int) -> int:
        """The next regular record or the next turn, whichever comes first."""
        turn = self.turns[self.leg(step)]
        return min(turn, (step // self.steps_per_record + 1) * self.steps_per_record)

    def is_snapshot(self, record: int, last: bool) -> bool:
        """Whether a record is kept with all contacts; `last`: whether it ends the path."""
        return bool(self.records_per_snapshot) and (last or record % self.records_per_snapshot == 0)

    def is_save(self, record: int, last: bool) -> bool:
        """Whether the file is saved after a record; `last`: whether it ends the path."""
        return last or record % self.records_per_save == 0


def run(
    specimen: State, path: Path, file: File, start: Start, options: Options = Options(), progress: Progress = silent
) -> bool:
    """Takes a specimen along a path and records it in a run file; goes on with a file that is unfinished.

    Returns False when the file held the finished run already. Raises InputError for a file with another
    run or one that another process is writing, PhysicsError when the simulation fails, Interrupted after a
    SIGINT or SIGTERM, with a checkpoint written.
    """
    settings = {
        "record_strain": options.record_strain or path.record_strain,
        "snapshots": options.snapshots,
        "engine": start.name,
        **{f"servo_{name}": value for name, value in vars(options.servo).items()},
        "guarded": options.guarded,
    }
    with Recorder(file, path, settings, specimen) as recorder:
        begun = recorder.resume()
        if begun and begun.complete:
            return False
        if not begun:
            specimen = prepare(specimen, path, start, progress, options.guarded)
        with stop_on_signals() as signals:
            return _Loop(recorder, specimen, begun, start, options, progress).go(signals)


def prepare(specimen: State, path: Path, start: Start, progress: Progress, guarded: bool = True) -> State:
    """The specimen at rest at the pressure that the path holds, consolidated if it is not there yet."""
    specimen = ready(specimen, start, guarded)
    pressure = path.start_pressure()
    if pressure is not None and pressure_error(specimen.snapshot(), pressure) > CONSOLIDATED:
        specimen = consolidate(specimen, pressure, start, lambda done, text: progress(0.0, text))
    return opened(specimen)


class _Loop:
    """The loop of a run and what it remembers between records."""

    def __init__(
        self,
        recorder: Recorder,
        specimen: State,
        begun: Begun | None,
        start: Start,
        options: Options,
        progress: Progress,
    ) -> None:
        self.recorder, self.path, self.progress = recorder, recorder.path, progress
        self.options, self.threads = options, start.threads
        self.first_cell = begun.first_cell if begun else specimen.cell
        self.wall_before = begun.wall_time if begun else 0.0
        self.started = time.monotonic()
        state = begun.state if begun else specimen
        self.schedule = Schedule.of(self.path, state.time_step, state.number_of_grains, options)
        self.stopped = False
        self.control = self.path.control()
        self.place = begun.place if begun else Place()
        self.engine = start(state)
        if begun:
            self.go_on_from(state, state.snapshot())
        else:
            state = self.engine.reload()
            self.record(state, last=False)
            self.save(state, False)

    def go_on_from(self, state: State, snapshot: Snapshot) -> None:
        """What the servo and the schedule need of a record, or of the checkpoint of a run that is resumed."""
        self.step = state.step
        self.time_step, self.gradient = state.time_step, state.velocity_gradient
        self.stiffness = cell_stiffness(snapshot, self.control.components) if self.control else None

    def go(self, signals: Signals) -> bool:
        last = False
        while not last:
            end = self.schedule.next_record(self.step)
            turned = self.advance(end, signals)
            last = self.stopped or self.step == self.schedule.steps
            if self.step < end and not last and not turned:
                self.save(self.engine.state(), False)
                raise self.interrupted(signals)
            last = self.record_and_save(last, signals)
            if signals.caught and not last:
                raise self.interrupted(signals)
        return True

    def record_and_save(self, last: bool, signals: Signals) -> bool:
        """Records, and saves where it is time; True if the run ends here. No State is kept while the run continues."""
        saving = self.schedule.is_save(self.recorder.records, last) or signals.caught
        state = self.engine.reload() if saving else self.engine.state()
        if lattice.tilt(state.cell) > lattice.MOST_TILT:
            U = lattice.reduction(state.cell)
            state = lattice.in_cell(state, U)
            self.engine.load(state)
            self.place = dataclasses.replace(self.place, lattice=self.place.lattice @ U)
        last = self.record(state, last)
        if saving or last:
            self.save(state, last)
        return last

    def advance(self, end: int, signals: Signals) -> bool:
        """Moves to the step `end`, or to where the path or a signal stops it; True if the path reverses there."""
        on_stress = self.path.reverses_on_stress
        turned = False
        while self.step < end and not self.stopped and not turned and not signals.caught:
            stress = self.engine.stress() if self.control else None
            reversals = self.place.leg if on_stress else self.schedule.leg(self.step)
            self.gradient = velocity_gradient(
                self.path,
                self.control,
                self.schedule.sign * (-1.0) ** reversals,
                self.time_step,
                stress,
                self.stiffness,
                self.gradient,
                self.options.servo,
                self.path.rate * self.time_step * self.step,
            )
            interval = self.options.servo.interval if self.control or on_stress else LISTEN
            steps = min(interval, end - self.step)
            self.engine.advance(steps, self.gradient)
            self.step += steps
            self.stopped = self.path.stops_early and self.path.stops(mean_stress(self.engine.stress()))
            if on_stress and self.path.leg_ends(self.engine.stress(), self.place.leg):
                turned, self.place = True, dataclasses.replace(self.place, leg=self.place.leg + 1)
                self.stopped = self.stopped or self.place.leg == self.path.legs()
        return turned

    def record(self, state: State, last: bool) -> bool:
        snapshot = state.snapshot()
        values = measure(state, self.first_cell @ self.place.lattice, snapshot)
        require_sane(values, state)
        if self.options.guarded:
            require_balanced(state, snapshot)
        last = last or self.path.ends(values)
        kept = self.schedule.is_snapshot(self.recorder.records, last)
        self.recorder.record(values, snapshot if kept else None)
        self.go_on_from(state, snapshot)
        self.progress(1.0 if last else state.step / self.schedule.steps, _status(values))
        return last

    def interrupted(self, signals: Signals) -> Interrupted:
        said = f"stopped by signal {signals.caught}; {self.recorder.file} is saved, the same command goes on from there"
        return Interrupted(said, 128 + signals.caught)

    def save(self, state: State, complete: bool) -> None:
        seconds = self.wall_before + time.monotonic() - self.started
        self.recorder.save(state, complete, seconds, self.threads, self.place)


def _status(values: dict) -> str:
    return f"strain {values['axial_strain']:.2%}, p {mean_stress(values['stress']) / 1e6:.3f} MPa"


def require_sane(values: dict, state: State) -> None:
    """Raises PhysicsError when a record shows that the integration has run away."""
    if not (np.all(np.isfinite(state.position)) and np.isfinite(values["kinetic_energy"])):
        raise PhysicsError(f"positions became NaN at step {state.step}: the time step is too large")
