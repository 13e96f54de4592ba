"""Takes the grains of a run along a path: moves the cell, and records and saves at stops."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Generator
from typing import Any

import numpy as np

from labkit.engines.base import Abilities, Advance, Load, Progress, Request, reload
from labkit.grains import lattice
from labkit.grains.state import State
from labkit.io.interruption import Signals
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path
from labkit.paths.rates import rate_of
from labkit.paths.step import Here, Record, Step
from labkit.paths.walk import Material, Stop, walk
from labkit.quantities.conditions import condition
from labkit.records.checkpoint import Checkpoint, Position
from labkit.records.energy import require_balanced
from labkit.records.instant import Instant
from labkit.records.ratcheting import Ratcheting, ratcheting_power
from labkit.records.recorder import Recorder, StoredRun
from labkit.records.schedule import Options, Schedule
from labkit.runs.endings import interrupted, require_false_at_start, require_sane, too_thin, unfinished
from labkit.runs.pace import pace, steps_at
from labkit.runs.progress import status_of
from labkit.servo.plan import Correcting, Corrections, ahead, correcting_of, corrections_of
from labkit.servo.reach import ERROR, Lag, errors, is_at_limit, unreachable

LISTEN = 50  # time steps between two checks for a signal or for the end of a path

Needs = Generator[Request, Any, None]


class Grains(Material):
    """The grains of a run.

    `here` is where the next step of the path starts, `first` the first record, and `step` the current step of the path,
    with its number. `now` is the time step, `stop` the time step of the last stop, and `instant` its Instant, until the
    run continues.
    """

    def __init__(
        self,
        path: Path,
        recorder: Recorder,
        state: State,
        stored: StoredRun | None,
        options: Options,
        progress: Progress,
        signals: Signals,
        threads: int,
    ) -> None:
        """Take the State at rest and, if the run is resumed, the run so far; nothing is loaded yet."""
        self.path, self.recorder, self.options = path, recorder, options
        self.progress, self.signals, self.threads = progress, signals, threads
        self.first: Record = stored.first if stored else {"cell": state.cell}
        self.began = time.monotonic() - (stored.wall_time if stored else 0.0)
        self.state = state = stored.state if stored else state
        self.schedule = Schedule.of(self.path, state.time_step, state.number_of_grains, options)
        self.position = stored.position if stored else Position()
        self.ratcheting = stored.ratcheting if stored else Ratcheting()
        self.time_step, self.now, self.stop = state.time_step, state.step, state.step
        self.ahead = ahead(state.number_of_grains)
        self.here = Here(self.position.stress, rate_of(self.path) * state.time_step)
        self.fresh, self.number, self.pace, self.wanted = stored is None, -1, 1.0, 1.0
        self.end = self.origin = 0  # planned time steps of the step of the path

    def run(self) -> Needs:
        """Carry the grains along the path from their current position."""
        self.abilities: Abilities = yield Load(self.state)
        at_rest = self.fresh and not self.state.velocity_gradient.any()  # otherwise it is as an engine left it
        self.instant: Instant | None = Instant((yield reload) if at_rest else self.state)
        del self.state
        if self.fresh:
            self.here.stress = yield lambda engine: engine.stress()
            self.position = dataclasses.replace(self.position, stress=self.here.stress)
        self.saving = self.turned = False
        begun = self.schedule.firsts[min(self.schedule.span(self.planned), len(self.schedule.firsts) - 1)]
        first = min(begun + self.position.leg, self.schedule.path_steps - 1)
        stop_when = condition(self.options.stop_when) if self.options.stop_when is not None else None
        yield from walk(self.path, self, self.schedule.path_steps, first, stop_when)

    @property
    def place(self) -> float:
        """The planned time step: steps so far at a pace of one, including those skipped because a step ended early."""
        moved = self.now - self.stop
        return self.stop + self.position.skipped + (self.pace * moved if moved else 0)

    @property
    def planned(self) -> int:
        """The planned time step of a stop."""
        return round(self.place)

    @property
    def accumulated(self) -> float:
        return self.here.step_strain * (self.place - self.origin)

    @property
    def rate(self) -> float:
        """The strain rate, 1/s."""
        return self.pace * rate_of(self.path)

    def enter(self, number: int, step: Step) -> None:
        span, schedule = self.schedule.span_of(number), self.schedule
        if self.number >= 0:
            left = 0 if span == schedule.span_of(self.number) else self.end - self.planned
            skipped, passed = self.position.skipped + left, number - schedule.firsts[span]
            stress = self.here.stress
            self.position = dataclasses.replace(self.position, leg=passed, skipped=skipped, stress=stress, lag=Lag())
        self.number, self.step, self.pace = number, step, 1.0
        self.end, self.origin = schedule.turns[span], schedule.start_of(span) if step.phase else 0
        if self.fresh:
            self.fresh = False
            self.arrive(self.measured(), False, False, "")
            if self.options.stop_when is not None:
                require_false_at_start(condition(self.options.stop_when), self.first)
            assert self.instant is not None
            self.recorder.save(self.checkpoint(self.instant.state, False))

    def advance(self) -> Generator[Request, object, Stop]:
        while True:
            self.leave()
            if self.signals.caught:
                self.recorder.flush()
                raise interrupted(self.recorder.output, self.signals.caught)
            end = self.next_stop()
            yield from self.move(end)
            if self.now == end or self.turned:
                self.position = dataclasses.replace(self.position, skipped=self.planned - self.now)
                self.stop = self.now
                if (yield from self.look()):
                    return self.measured()

    def leave(self) -> None:
        """Continue from a stop: set the variables of the servo, and note a checkpoint."""
        if self.instant is None:
            return
        state, step, instant = self.instant.state, self.step, self.instant
        self.gradient, self.stiffness = state.velocity_gradient, None
        if step.held is not None:
            self.stiffness = instant.stiffness(step.held.components)
        if self.options.inertial_number is not None:
            grains = 2.0 * float(state.body_radius.mean()), state.scene.density, float(mean_stress(instant.stress))
            given = self.options.inertial_number, step, rate_of(self.path), self.pace, self.accumulated
            self.wanted = pace(*given, *grains)
        if self.saving:
            self.recorder.checkpoint(self.checkpoint(instant.state, False))
        self.instant, self.saving = None, False  # no State stays in memory while the run continues

    def next_stop(self) -> int:
        """Return the time step of the next stop, at the current pace."""
        planned = self.schedule.next_stop(self.planned) - self.planned
        steps, self.pace = (planned, 1.0) if self.options.inertial_number is None else steps_at(self.wanted, planned)
        return self.now + steps

    def move(self, end: int) -> Needs:
        """Advance to the time step `end`, or to where a stress ends the step of the path or a signal stops the run."""
        step, stress = self.step, None  # the stress of this instant, once it is needed
        self.turned = False
        follows = self.abilities.follow is not None and not step.stress_ends
        most = self.ahead if follows else 1
        servo = correcting_of(step, self.rate, self.stiffness, self.time_step, self.options.servo)
        while self.now < end and not self.turned and not self.signals.caught:
            corrections = self.plan(end, servo, most)
            if follows:
                yield corrections
                continue
            if step.held is not None and stress is None:
                stress = yield lambda engine: engine.stress()
            self.gradient = corrections.velocity_gradient(0, self.time_step, stress, self.gradient)
            yield Advance(corrections.total, self.gradient)
            stress = None
            if step.stress_ends:
                stress = yield lambda engine: engine.stress()
                self.turned = step.ends_at(stress)
        if self.turned and step.length is None:
            self.position = dataclasses.replace(self.position, leg=self.position.leg + 1)

    @property
    def starting(self) -> bool:
        """True at the start of a phase, when other stresses may be held."""
        return self.step.phase is not None and self.place == self.origin

    def interval(self, end: int) -> int:
        """Time steps to the next correction, but at most to `end` or to an abrupt change of the prescribed rates."""
        feedback = self.step.held is not None or self.step.length is None
        steps = min(self.options.servo.interval if feedback else LISTEN, end - self.now)
        if self.step.phase is None:
            return steps
        missing = (self.step.phase.next_change(self.accumulated) - self.accumulated) / (self.rate * self.time_step)
        return min(steps, max(1, round(missing))) if missing < self.schedule.steps else steps

    def plan(self, end: int, servo: Correcting | None, most: int) -> Corrections:
        """Return the intervals of the coming `most` time steps or more, at most up to the time step `end`."""
        anew, last, steps, accumulated = self.starting, min(end, self.now + most), list[int](), list[float]()
        step = self.step
        alike = step.phase is None and not callable(step.given) and not callable(getattr(step.held, "target", None))
        while self.now < last:
            interval, number = self.interval(end), 1
            if alike:
                number = max(1, (last - self.now) // interval)
            steps += [interval] * number
            accumulated.append(self.accumulated)
            self.now += number * interval
        return corrections_of(self.step, self.rate, self.time_step, servo, steps, accumulated, anew)

    @property
    def ended(self) -> bool:
        """True if the stress that ends the last step of the path is reached."""
        return self.turned and self.number + 1 == self.schedule.path_steps

    def look(self) -> Generator[Request, Any, bool]:
        """Examine a stop; True if it is recorded."""
        self.recorder.wait()  # user code runs next and may open files
        last = self.ended or self.place == self.schedule.steps
        self.saving = self.schedule.is_checkpoint(self.planned, last)
        self.instant = Instant((yield reload if self.saving else lambda engine: engine.state()))
        yield from self.reduce()
        return last or self.turned or self.schedule.is_record(self.planned)

    def reduce(self) -> Needs:
        """Replace the cell by an equivalent one if shear has tilted it by more than one half."""
        assert self.instant is not None
        state = self.instant.state
        if lattice.tilt(state.cell) <= lattice.MOST_TILT:
            return
        U = lattice.reduction(state.cell)
        self.position = dataclasses.replace(self.position, lattice=self.position.lattice @ U)
        state = lattice.in_cell(state, U)
        yield Load(state)
        self.instant = Instant(state)

    def measured(self) -> Stop:
        """Return the record of this stop, and say what ends here."""
        assert self.instant is not None
        values = self.instant.measure(self.first["cell"] @ self.position.lattice)
        if self.step.phase is not None:
            values |= self.step.phase.progress(self.accumulated)
        if self.options.inertial_number is not None:
            values["accumulated_strain"] = self.here.step_strain * self.place
        if not self.recorder.records:
            self.first = values
        at_end, by_stress = self.place == self.end, self.step.length is None
        return Stop(values, self.turned or (at_end and not by_stress), at_end and by_stress)

    def arrive(self, stop: Stop, over: bool, last: bool, reason: str) -> None:
        assert self.instant is not None
        state, values, recorder = self.instant.state, dict(stop.record), self.recorder
        require_sane(values, state.step)
        power = ratcheting_power(state, self.instant.snapshot)
        self.ratcheting.add(recorder.records, state.time, power)
        if self.options.guarded:
            require_balanced(state, None, values["energy_balance_error"] + self.ratcheting.error(state))
        if self.ended and self.schedule.is_close_to_record(self.planned):
            if not self.schedule.is_snapshot(recorder.records - 1, last=False):
                recorder.drop_last()
        if not last and self.options.guarded and recorder.records:
            reason = too_thin(state) or self.lost(state, np.asarray(values["stress"]))
        kept = self.schedule.is_snapshot(recorder.records, last or bool(reason)) or self.is_kept_turn()
        recorder.record(values, self.instant.snapshot if kept else None)
        done = max(self.place / self.schedule.steps, self.position.leg / self.schedule.path_steps)
        text = status_of(self.path, values, self.number, self.schedule.path_steps)
        self.progress(1.0 if last else done, text)
        if last or reason:
            recorder.save(self.checkpoint(state, last, reason))
        if reason and not last:
            raise unfinished(reason, recorder.output)

    def is_kept_turn(self) -> bool:
        """True if the record at a reversal triggered by stress is stored with all contacts.

        At most `snapshots` of these records are stored with their contacts.
        """
        number = self.options.snapshots
        turned = self.turned and self.step.length is None
        return turned and bool(number) and self.position.leg % -(-self.schedule.path_steps // number) == 0

    def lost(self, state: State, stress: np.ndarray) -> str:
        """Say why a held stress can no longer reach its target; empty if it can. `stress` (3, 3) in Pa."""
        step, phase, rate = self.step, self.step.phase, self.rate
        reason = "" if phase is None else phase.lost(stress, self.accumulated)
        if reason or step.held is None:
            return reason
        limit, given = rate * step.rate_limit, rate * step.rates(self.accumulated)
        error = float(errors(step.held, stress, self.accumulated).max())
        strain = limit / self.pace * state.time_step * self.schedule.steps_per_record
        at_limit = error > ERROR and is_at_limit(step.held, -state.velocity_gradient, given, limit)
        lag = self.position.lag.after(strain, error, at_limit)
        self.position = dataclasses.replace(self.position, lag=lag)
        if not lag.hopeless:
            return ""
        label = "" if phase is None else phase.label
        return label + unreachable(step.held, step.held.names, stress, self.accumulated)

    def checkpoint(self, state: State, complete: bool, reason: str = "") -> Checkpoint:
        """Return the Checkpoint of a State of this run; `reason` says why the run ended early, if it did."""
        seconds, created = time.monotonic() - self.began, self.ratcheting.copied()
        return Checkpoint(state, complete, seconds, self.threads, self.position, reason, created)
