"""Combines specimen, path, engine and recorder into a run, which is resumed if it was interrupted."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path as File
from typing import Any

import numpy as np

from labkit.dem import lattice
from labkit.dem.consolidation import consolidate, pressure_error
from labkit.dem.control import Control
from labkit.dem.energy import opened, require_balanced
from labkit.dem.engine import Progress, Start, silent
from labkit.dem.measure import measure
from labkit.dem.paths import Path
from labkit.dem.reach import errors, is_at_limit, unreachable
from labkit.dem.recorder import Position, Recorder, StoredRun
from labkit.dem.schedule import Options, Schedule
from labkit.dem.servo import cell_stiffness, velocity_gradient
from labkit.dem.specimen import ready
from labkit.dem.state import State
from labkit.errors import Interrupted, PhysicsError
from labkit.io.interruption import Signals, stop_on_signals
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import mean_stress

CONSOLIDATED = 2e-3  # of the pressure: a specimen closer to it than this is not consolidated again
LISTEN = 50  # steps between two checks for a signal or for the end of a path


def run(
    specimen: State,
    path: Path,
    file: File,
    start: Start,
    options: Options | None = None,
    progress: Progress = silent,
) -> bool:
    """Load a specimen along a path and record it in a run file; resume an unfinished file.

    Returns False if the file already held the finished run. Raises InputError for a file that holds another run or that
    another process is writing, PhysicsError if the simulation fails or a held stress cannot reach its target,
    Interrupted after SIGINT or SIGTERM, once a checkpoint is written.
    """
    path, options = path.for_scene(specimen.scene), options or Options()
    settings = {
        "record_strain": options.record_strain or path.record_strain,
        "snapshots": options.snapshots,
        "engine": start.name,
        **{f"servo_{name}": value for name, value in vars(options.servo).items()},
        "guarded": options.guarded,
    }
    with Recorder(file, path, settings, specimen) as recorder:
        stored = recorder.resume()
        if stored and stored.complete:
            return False
        if stored and stored.ended_because:
            raise unfinished(stored.ended_because, file)
        if not stored:
            specimen = prepare(specimen, path, start, progress, options.guarded)
        with stop_on_signals() as signals:
            return _Loop(recorder, specimen, stored, start, options, progress).execute(signals)


def prepare(specimen: State, path: Path, start: Start, progress: Progress, guarded: bool = True) -> State:
    """The specimen at rest at the initial pressure of the path, consolidated first if necessary."""
    specimen = ready(specimen, start, guarded)
    pressure = path.start_pressure()
    if pressure is not None and pressure_error(specimen.snapshot(), pressure) > CONSOLIDATED:
        specimen = consolidate(specimen, pressure, start, lambda done, text: progress(0.0, text))
    return opened(specimen)


class _Loop:
    """The loop of a run and its variables between records."""

    def __init__(
        self,
        recorder: Recorder,
        specimen: State,
        stored: StoredRun | None,
        start: Start,
        options: Options,
        progress: Progress,
    ) -> None:
        self.recorder, self.path, self.progress = recorder, recorder.path, progress
        self.options, self.threads = options, start.threads
        self.first_cell = stored.first_cell if stored else specimen.cell
        self.wall_before = stored.wall_time if stored else 0.0
        self.started = time.monotonic()
        state = stored.state if stored else specimen
        self.schedule = Schedule.of(self.path, state.time_step, state.number_of_grains, options)
        self.stopped = False
        self.ended_because = ""
        self.control = self.path.control()
        self.position = stored.position if stored else Position()
        self.engine = start(state)
        if stored:
            self.continue_from(state, state.snapshot())
        else:
            state = self.engine.reload()
            self.record(state, last=False)
            self.save(state, False)

    def continue_from(self, state: State, snapshot: Snapshot) -> None:
        """Set the step and the variables of the servo from a state of the run."""
        self.step = state.step
        self.time_step, self.gradient = state.time_step, state.velocity_gradient
        self.stiffness = cell_stiffness(snapshot, self.control.components) if self.control else None

    def execute(self, signals: Signals) -> bool:
        last = False
        while not last:
            stop = self.schedule.next_stop(self.step)
            turned = self.advance(stop, signals)
            last = self.stopped or self.step == self.schedule.steps
            if self.step < stop and not last and not turned:
                self.save(self.engine.state(), False)
                raise self.interrupted(signals)
            last = self.record_and_save(last, turned, signals)
            if signals.caught and not last:
                raise self.interrupted(signals)
        return True

    def record_and_save(self, last: bool, turned: bool, signals: Signals) -> bool:
        """Handle one stop, and return True if the path ends there.

        A separate function, so that no State stays in memory while the run continues.
        """
        saving = self.schedule.is_save(self.step, last) or signals.caught
        state = self.engine.reload() if saving else self.engine.state()
        state = self.reduced(state)
        if last or turned or self.schedule.is_record(self.step):
            last = self.record(state, last, turned)
        else:
            self.continue_from(state, state.snapshot())
        if self.ended_because and not last:
            self.save(state, False)
            raise unfinished(self.ended_because, self.recorder.file)
        if saving or last:
            self.save(state, last)
        return last

    def reduced(self, state: State) -> State:
        """The state in an equivalent cell if shear has tilted its cell by more than one half."""
        if lattice.tilt(state.cell) <= lattice.MOST_TILT:
            return state
        U = lattice.reduction(state.cell)
        self.position = dataclasses.replace(self.position, lattice=self.position.lattice @ U)
        state = lattice.in_cell(state, U)
        self.engine.load(state)
        return state

    def advance(self, end: int, signals: Signals) -> bool:
        """Advance to the step `end`, or to where the path or a signal stops the run.

        Returns True if the path reverses there because of a stress.
        """
        on_stress = self.path.reverses_on_stress
        turned, stress = False, None  # of this instant, if it was needed
        while self.step < end and not self.stopped and not turned and not signals.caught:
            leg = self.position.leg if on_stress else self.schedule.leg(self.step)
            if self.control and stress is None:
                stress = self.engine.stress()
            self.gradient = velocity_gradient(
                self.path,
                self.schedule.sign * (-1.0) ** leg,
                self.time_step,
                stress,
                self.stiffness,
                self.gradient,
                self.options.servo,
                self.path.axial_rate * self.time_step * self.step,
                self.control,
            )
            steps = min(self.options.servo.interval if self.control or on_stress else LISTEN, end - self.step)
            self.engine.advance(steps, self.gradient)
            self.step += steps
            stress = None
            if self.path.stops_early or on_stress:
                stress = self.engine.stress()
                self.stopped = self.path.stops(float(mean_stress(stress)))
                turned = self.path.leg_ends(stress, leg)
            if turned:
                self.position = dataclasses.replace(self.position, leg=leg + 1)
                self.stopped = self.stopped or leg + 1 == self.path.legs()
        return turned

    def record(self, state: State, last: bool, turned: bool = False) -> bool:
        snapshot = state.snapshot()
        values = measure(state, self.first_cell @ self.position.lattice, snapshot)
        last = last or self.path.ends(values)
        require_sane(values, state)
        if self.options.guarded:
            require_balanced(state, snapshot)
        if self.stopped and self.schedule.is_close_to_record(state.step):
            if not self.schedule.is_snapshot(self.recorder.records - 1, last=False):
                self.recorder.drop_last()
        if last:
            self.ended_because = self.path.why_ended(values, self.position.leg)
        elif self.control and self.options.guarded and self.recorder.records:
            self.follow(self.control, state, np.asarray(values["stress"]))
        kept = self.schedule.is_snapshot(self.recorder.records, last or bool(self.ended_because))
        self.recorder.record(values, snapshot if kept or (turned and self.is_kept_turn()) else None)
        self.continue_from(state, snapshot)
        leg = self.position.leg if self.path.reverses_on_stress else self.schedule.leg(state.step)
        done = max(state.step / self.schedule.steps, self.position.leg / self.path.legs())
        self.progress(1.0 if last else done, self.path.status(values, leg))
        return last

    def follow(self, control: Control, state: State, stress: np.ndarray) -> None:
        """Notice a held stress that cannot reach its target (labkit.dem.reach)."""
        rate = self.path.axial_rate
        travelled, limit = rate * state.time_step * state.step, rate * self.path.rate_limit
        leg = self.position.leg if self.path.reverses_on_stress else self.schedule.leg(state.step - 1)
        given = self.schedule.sign * (-1.0) ** leg * rate * self.path.flow(travelled)
        at_limit = is_at_limit(control, -state.velocity_gradient, given, limit)
        error = float(errors(control, stress, travelled).max())
        strain = limit * state.time_step * self.schedule.steps_per_record
        lag = self.position.lag.after(strain, error, at_limit)
        self.position = dataclasses.replace(self.position, lag=lag)
        if lag.hopeless:
            self.ended_because = unreachable(control, control.names, stress, travelled)

    def is_kept_turn(self) -> bool:
        """True if the record at a reversal triggered by stress is stored with all contacts.

        At most `snapshots` of these records are stored with their contacts.
        """
        number = self.options.snapshots
        return bool(number) and self.position.leg % -(-self.path.legs() // number) == 0

    def interrupted(self, signals: Signals) -> Interrupted:
        return Interrupted(
            f"stopped by signal {signals.caught}; {self.recorder.file} is saved: give the same command to resume it",
            128 + signals.caught,
        )

    def save(self, state: State, complete: bool) -> None:
        seconds = self.wall_before + time.monotonic() - self.started
        self.recorder.save(state, complete, seconds, self.threads, self.position, self.ended_because)


def unfinished(reason: str, file: File) -> PhysicsError:
    """The error of a run that cannot be completed; its records up to there are in the file."""
    return PhysicsError(f"{reason}; the records up to there are in {file} (complete = 0)")


def require_sane(values: dict[str, Any], state: State) -> None:
    """Raise PhysicsError if a record shows that the integration has become unstable."""
    if not (np.all(np.isfinite(state.position)) and np.isfinite(values["kinetic_energy"])):
        raise PhysicsError(f"positions became NaN at step {state.step}: the time step is too large")
