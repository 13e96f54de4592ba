"""Combines specimen, path, engine and recorder into a run, which is resumed if it was interrupted."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path as File
from typing import Any

import numpy as np

from labkit.dem import lattice
from labkit.dem.checkpoint import Checkpoint, Position
from labkit.dem.conditions import condition
from labkit.dem.consolidation import consolidate, pressure_error
from labkit.dem.corrections import AHEAD, Planner
from labkit.dem.endings import require_false_at_start, require_sane, unfinished
from labkit.dem.energy import opened, require_balanced
from labkit.dem.engine import Progress, Start, silent
from labkit.dem.instant import Instant
from labkit.dem.interim import interim_of
from labkit.dem.pace import TRAVELLED, pace, steps_at
from labkit.dem.paths import Path
from labkit.dem.ratcheting import Ratcheting, ratcheting_power
from labkit.dem.reach import Lag, errors, is_at_limit, require_way, unreachable
from labkit.dem.recorder import Recorder, StoredRun
from labkit.dem.schedule import Options, Schedule
from labkit.dem.servo import velocity_gradient
from labkit.dem.specimen import ready
from labkit.dem.state import State
from labkit.errors import Interrupted
from labkit.io.interruption import Signals, stop_on_signals
from labkit.micro.stress import love_stress, mean_stress

CONSOLIDATED = 2e-3  # of the pressure: a specimen closer to it than this is not consolidated again
LATER = ("stop_when", "inertial_number")  # options that files of version 0.1.0 lack
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
        **{name: value for name in LATER if (value := getattr(options, name)) is not None},
        **({"precision": start.precision} if start.precision != "double" else {}),
    }
    extra = TRAVELLED if options.inertial_number is not None else {}
    with Recorder(file, path, settings, specimen, extra, all_saved=options.save_every is not None) as recorder:
        stored = recorder.resume()
        if stored and stored.complete:
            return False
        if stored and stored.ended_because:
            raise unfinished(stored.ended_because, file)
        if not stored:
            specimen = prepare(specimen, path, start, progress, options.guarded, interim_of(file))
            require_way(path, float(mean_stress(love_stress(specimen.snapshot()))))
        with stop_on_signals() as signals:
            return _Loop(recorder, specimen, stored, start, options, progress).execute(signals)


def prepare(
    specimen: State, path: Path, start: Start, progress: Progress, guarded: bool = True, interim: File | None = None
) -> State:
    """The specimen at rest at the initial pressure of the path, consolidated first if necessary (see consolidate)."""
    specimen = ready(specimen, start, guarded)
    pressure = path.start_pressure()
    if pressure is not None and pressure_error(specimen.snapshot(), pressure) > CONSOLIDATED:
        specimen = consolidate(specimen, pressure, start, lambda done, text: progress(0.0, text), interim)
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
        self.first: dict[str, Any] = stored.first if stored else {"cell": specimen.cell}  # the first record
        self.stop_when = condition(options.stop_when) if options.stop_when is not None else None
        self.wall_before = stored.wall_time if stored else 0.0
        self.started = time.monotonic()
        state = stored.state if stored else specimen
        self.schedule = Schedule.of(self.path, state.time_step, state.number_of_grains, options)
        self.stopped = False
        self.ended_because = ""
        self.position = stored.position if stored else Position()
        self.ratcheting = stored.ratcheting if stored else Ratcheting()
        self.engine = start(state)
        state = state if stored else self.engine.reload()
        self.step, self.time_step = state.step, state.time_step
        self.stop = self.step  # the step at which the run last stopped
        if stored:
            self.enter_leg()
            self.continue_from(Instant(state))
        else:
            self.position = dataclasses.replace(self.position, stress=self.engine.stress())
            self.enter_leg()
            self.record(Instant(state), last=False)
            require_false_at_start(self.stop_when, self.first)
            self.recorder.save(self.checkpoint(state, False))

    @property
    def place(self) -> float:
        """The planned step: time steps so far at a pace of one, with those left out because legs ended early."""
        moved = self.step - self.stop
        return self.stop + self.position.skipped + (self.leg.pace * moved if moved else 0)

    @property
    def planned(self) -> int:
        """The planned step of a stop."""
        return round(self.place)

    @property
    def travelled(self) -> float:
        """Accumulated strain of the path, or of the leg if it counts its own."""
        return self.path.axial_rate * self.time_step * (self.place - self.leg.first)

    def enter_leg(self) -> None:
        """Set the variables of the leg to which the motion from this step on belongs."""
        path, schedule = self.path, self.schedule
        leg = self.position.leg if path.reverses_on_stress else schedule.leg(self.planned)
        self.number = min(leg, path.legs() - 1)
        sign = schedule.sign * (-1.0) ** self.number
        first, self.leg_end = (0, schedule.steps) if path.reverses_on_stress else schedule.span(self.number)
        step_strain = path.axial_rate * self.time_step
        self.leg = path.leg(self.number, sign, self.position.stress, first, self.leg_end - first, step_strain)
        self.control = self.leg.control()

    def end_leg(self, stress: np.ndarray) -> None:
        """Pass on to the next leg at a record with this stress (3, 3), Pa."""
        left = 0 if self.path.reverses_on_stress else self.leg_end - self.planned
        settled = self.leg.settled(stress, self.travelled)
        skipped = self.position.skipped + left
        self.position = dataclasses.replace(self.position, skipped=skipped, stress=settled, lag=Lag())
        self.enter_leg()

    def continue_from(self, instant: Instant) -> None:
        """Set the variables of the servo from an instant of the run."""
        state = instant.brief
        self.gradient = state.velocity_gradient
        self.stiffness = self.engine.beside(instant.stiffness, self.control.components) if self.control else None
        if self.options.inertial_number is not None:
            grains = 2.0 * float(state.radius.mean()), state.scene.density, float(mean_stress(instant.stress()))
            self.pace = pace(self.options.inertial_number, self.leg, self.travelled, *grains)

    def execute(self, signals: Signals) -> bool:
        last = False
        while not last:
            end = self.next_stop()
            turned = self.advance(end, signals)
            if self.step == end or self.stopped or turned:
                self.arrive()
                last = self.record_and_save(self.stopped or self.place == self.schedule.steps, turned)
            if signals.caught and not last:
                self.recorder.flush()
                raise self.interrupted(signals)
        return True

    def next_stop(self) -> int:
        """The time step of the next stop, at the pace up to there."""
        planned = self.schedule.next_stop(self.planned) - self.planned
        steps, rate = (planned, 1.0) if self.options.inertial_number is None else steps_at(self.pace, planned)
        self.leg = dataclasses.replace(self.leg, pace=rate)
        return self.step + steps

    def arrive(self) -> None:
        """Count from this stop on, at a whole planned step."""
        self.position = dataclasses.replace(self.position, skipped=self.planned - self.step)
        self.stop = self.step

    def record_and_save(self, last: bool, turned: bool) -> bool:
        """Handle one stop, and return True if the path ends there.

        A separate function, so that no State stays in memory while the run continues.
        """
        self.recorder.wait()  # before code of the user runs, which may open files
        saving = self.schedule.is_checkpoint(self.planned, last)
        instant = self.reduced(Instant(self.engine.reload()) if saving else self.engine.instant())
        if last or turned or self.schedule.is_record(self.planned):
            last = self.record(instant, last, turned)
        else:
            self.continue_from(instant)
        if self.ended_because and not last:
            self.recorder.save(self.checkpoint(instant.state, False))
            raise unfinished(self.ended_because, self.recorder.file)
        if last:
            self.recorder.save(self.checkpoint(instant.state, True))
        elif saving:
            self.recorder.checkpoint(self.checkpoint(instant.state, False))
        return last

    def reduced(self, instant: Instant) -> Instant:
        """The instant in an equivalent cell if shear has tilted its cell by more than one half."""
        state = instant.brief
        if lattice.tilt(state.cell) <= lattice.MOST_TILT:
            return instant
        state = instant.state
        U = lattice.reduction(state.cell)
        self.position = dataclasses.replace(self.position, lattice=self.position.lattice @ U)
        state = lattice.in_cell(state, U)
        self.engine.load(state)
        return Instant(state)

    def advance(self, end: int, signals: Signals) -> bool:
        """Advance to the step `end`, or to where the path or a signal stops the run.

        Returns True if the path reverses there because of a stress.
        """
        on_stress = self.path.reverses_on_stress
        turned, stress = False, None  # of this instant, if it was needed
        while self.step < end and not self.stopped and not turned and not signals.caught:
            if self.engine.follows and not self.path.stops_early and not on_stress:
                self.follow(end)
                continue
            if self.control and stress is None:
                stress = self.engine.stress()
            starting = self.leg.restarts and self.place == self.leg.first  # other stresses may be held from now on
            self.gradient = velocity_gradient(
                self.leg,
                self.leg.sign,
                self.time_step,
                stress,
                self.stiffness,
                np.zeros((3, 3)) if starting else self.gradient,
                self.options.servo,
                self.travelled,
                self.control,
            )
            steps = self.interval(end)
            self.engine.advance(steps, self.gradient)
            self.step += steps
            stress = None
            if self.path.stops_early or on_stress:
                stress = self.engine.stress()
                self.stopped = self.path.stops(float(mean_stress(stress)))
                turned = self.path.leg_ends(stress, self.number)
            if turned:
                self.position = dataclasses.replace(self.position, leg=self.number + 1)
                self.stopped = self.stopped or self.number + 1 == self.path.legs()
        return turned

    def interval(self, end: int) -> int:
        """Time steps to the next correction: at most to the step `end`, or to an abrupt change of the given rates."""
        feedback = self.control or self.path.reverses_on_stress
        steps = min(self.options.servo.interval if feedback else LISTEN, end - self.step)
        missing = (self.leg.next_change(self.travelled) - self.travelled) / (self.leg.axial_rate * self.time_step)
        return min(steps, max(1, round(missing))) if missing < self.schedule.steps else steps

    def follow(self, end: int) -> None:
        """Advance up to the step `end`, at most AHEAD steps, with an engine that runs the servo itself."""
        first = self.step
        anew = self.leg.restarts and self.place == self.leg.first
        planner = Planner(self.leg, self.control, self.time_step)
        while self.step < min(end, first + AHEAD):
            steps = self.interval(end)
            planner.add(steps, self.travelled)
            self.step += steps
        self.engine.follow(planner.corrections(self.stiffness, self.options.servo, anew))

    def record(self, instant: Instant, last: bool, turned: bool = False) -> bool:
        values = self.engine.beside(instant.measure, self.first["cell"] @ self.position.lattice)
        state = instant.brief
        values |= self.leg.progress(self.travelled)
        if self.options.inertial_number is not None:
            values["accumulated_strain"] = self.path.axial_rate * self.time_step * self.place
        if not self.recorder.records:
            self.first = values
        ended = turned or self.place == self.leg_end
        ended = ended or (self.recorder.records > 0 and self.leg.stops(values, self.first))
        last = last or self.path.ends(values) or (ended and self.number + 1 == self.path.legs())
        last = last or (self.stop_when is not None and self.stop_when.holds(values, self.first))
        require_sane(values, state.step)
        self.ratcheting.add(self.recorder.records, state.time, self.engine.beside(ratcheting_power, state))
        if self.options.guarded:
            require_balanced(state, None, values["energy_balance_error"] + self.ratcheting.error(state))
        if self.stopped and self.schedule.is_close_to_record(self.planned):
            if not self.schedule.is_snapshot(self.recorder.records - 1, last=False):
                self.recorder.drop_last()
        if last:
            by_condition = self.stop_when is not None and self.stop_when.holds(values, self.first)
            self.ended_because = "" if by_condition else self.path.why_ended(values, self.position.leg)
        elif self.options.guarded and self.recorder.records:
            self.ended_because = self.lost(state, np.asarray(values["stress"]))
        kept = self.schedule.is_snapshot(self.recorder.records, last or bool(self.ended_because))
        self.recorder.record(values, instant.snapshot if kept or (turned and self.is_kept_turn()) else None)
        done, number = max(self.place / self.schedule.steps, self.position.leg / self.path.legs()), self.number
        if ended and not last:
            self.end_leg(values["stress"])
        self.continue_from(instant)
        self.progress(1.0 if last else done, self.path.status(values, number))
        return last

    def lost(self, state: State, stress: np.ndarray) -> str:
        """Why a held stress cannot reach its target any more, one sentence; empty if it can. stress: (3, 3), Pa."""
        reason = self.leg.lost(stress, self.travelled)
        if reason or not self.control:
            return reason
        rate = self.leg.axial_rate
        limit, given = rate * self.leg.rate_limit, self.leg.sign * rate * self.leg.flow(self.travelled)
        error = float(errors(self.control, stress, self.travelled).max())
        strain = limit / self.leg.pace * state.time_step * self.schedule.steps_per_record
        lag = self.position.lag.after(strain, error, is_at_limit(self.control, -state.velocity_gradient, given, limit))
        self.position = dataclasses.replace(self.position, lag=lag)
        if not lag.hopeless:
            return ""
        return self.leg.label + unreachable(self.control, self.control.names, stress, self.travelled)

    def is_kept_turn(self) -> bool:
        """True if the record at a reversal triggered by stress is stored with all contacts.

        At most `snapshots` of these records are stored with their contacts.
        """
        number = self.options.snapshots
        return bool(number) and self.position.leg % -(-self.path.legs() // number) == 0

    def interrupted(self, signals: Signals) -> Interrupted:
        said = f"{self.recorder.file} is saved: give the same command to resume it"
        return Interrupted(f"stopped by signal {signals.caught}; {said}", 128 + signals.caught)

    def checkpoint(self, state: State, complete: bool) -> Checkpoint:
        """The Checkpoint of a State of this run."""
        seconds, created = self.wall_before + time.monotonic() - self.started, self.ratcheting.copied()
        return Checkpoint(state, complete, seconds, self.threads, self.position, self.ended_because, created)
