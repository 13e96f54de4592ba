"""Joins specimen, path, engine and recorder in one run, resumed if it was interrupted."""

from __future__ import annotations

import time
from pathlib import Path as File
from typing import Any

import numpy as np

from labkit.dem.consolidation import consolidate, pressure_error
from labkit.dem.energy import opened, require_balanced
from labkit.dem.engine import Progress, Start, silent
from labkit.dem.measure import measure
from labkit.dem.paths import Path
from labkit.dem.recorder import Recorder, StoredRun
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
    another process is writing, PhysicsError if the simulation fails, Interrupted after SIGINT or SIGTERM, once a
    checkpoint is written.
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
        self.stiffness = cell_stiffness(snapshot) if self.path.control() else None

    def execute(self, signals: Signals) -> bool:
        last = False
        while not last:
            stop = self.schedule.next_stop(self.step)
            self.advance(stop, signals)
            last = self.stopped or self.step == self.schedule.steps
            if self.step < stop and not last:
                self.save(self.engine.state(), False)
                raise self.interrupted(signals)
            self.record_and_save(last, signals)
            if signals.caught and not last:
                raise self.interrupted(signals)
        return True

    def record_and_save(self, last: bool, signals: Signals) -> None:
        """Handle one stop; a separate function, so that no State stays in memory while the run continues."""
        saving = self.schedule.is_save(self.step, last) or signals.caught
        state = self.engine.reload() if saving else self.engine.state()
        if last or self.schedule.is_record(self.step):
            self.record(state, last)
        else:
            self.continue_from(state, state.snapshot())
        if saving:
            self.save(state, last)

    def advance(self, end: int, signals: Signals) -> None:
        """Advance to the step `end`, or to where the path or a signal stops the run."""
        while self.step < end and not self.stopped and not signals.caught:
            stress = self.engine.stress() if self.stiffness is not None else None
            self.gradient = velocity_gradient(
                self.path,
                self.schedule.sign(self.step),
                self.time_step,
                stress,
                self.stiffness,
                self.gradient,
                self.options.servo,
            )
            steps = min(self.options.servo.interval if self.stiffness is not None else LISTEN, end - self.step)
            self.engine.advance(steps, self.gradient)
            self.step += steps
            self.stopped = self.path.stops_early and self.path.stops(float(mean_stress(self.engine.stress())))

    def record(self, state: State, last: bool) -> None:
        snapshot = state.snapshot()
        values = measure(state, self.first_cell, snapshot)
        require_sane(values, state)
        if self.options.guarded:
            require_balanced(state, snapshot)
        if self.stopped and self.schedule.is_close_to_record(state.step):
            if not self.schedule.is_snapshot(self.recorder.records - 1, last=False):
                self.recorder.drop_last()
        kept = self.schedule.is_snapshot(self.recorder.records, last)
        self.recorder.record(values, snapshot if kept else None)
        self.continue_from(state, snapshot)
        self.progress(1.0 if last else state.step / self.schedule.steps, _status(values))

    def interrupted(self, signals: Signals) -> Interrupted:
        return Interrupted(
            f"stopped by signal {signals.caught}; {self.recorder.file} is saved: give the same command to resume it",
            128 + signals.caught,
        )

    def save(self, state: State, complete: bool) -> None:
        self.recorder.save(state, complete, self.wall_before + time.monotonic() - self.started, self.threads)


def _status(values: dict[str, Any]) -> str:
    return f"strain {values['axial_strain']:.2%}, p {mean_stress(values['stress']) / 1e6:.3f} MPa"


def require_sane(values: dict[str, Any], state: State) -> None:
    """Raise PhysicsError if a record shows that the integration has become unstable."""
    if not (np.all(np.isfinite(state.position)) and np.isfinite(values["kinetic_energy"])):
        raise PhysicsError(f"positions became NaN at step {state.step}: the time step is too large")
