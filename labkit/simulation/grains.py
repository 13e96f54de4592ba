"""Carries the grains of a run along a path: moves the cell, and records and saves at stops."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Generator
from typing import NoReturn

import numpy as np

from labkit.engines.base import Abilities, Load, Progress, Request, reload
from labkit.engines.device import Device
from labkit.grains import lattice
from labkit.grains.state import State
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import void_ratio
from labkit.paths.ending import Cause, Ending
from labkit.paths.facts import facts_of
from labkit.paths.path import Path
from labkit.paths.rates import rate_of
from labkit.paths.step import Here, Record, Step
from labkit.paths.walk import Material, Stop, walk
from labkit.process.interruption import Signals
from labkit.quantities.conditions import Condition, condition
from labkit.records.checkpoint import Checkpoint, Position
from labkit.records.energy import require_balanced
from labkit.records.instant import Instant
from labkit.records.limits import inertial_number_of
from labkit.records.ratcheting import ratcheting_power
from labkit.records.recorder import Recorder, StoredRun
from labkit.records.schedule import Options, Schedule
from labkit.results.endings import require_false_at_start, require_sane, too_thin, unfinished_error
from labkit.servo.plan import ahead
from labkit.servo.reach import ERROR, errors, is_at_limit, unreachable
from labkit.simulation.clock import PathClock, pace, steps_at
from labkit.simulation.loading import Loading
from labkit.simulation.progress import status_of
from labkit.simulation.stopping import Stopping
from labkit.specimens.ready import Answer

Needs = Generator[Request, Answer, None]


class Grains(Material):
    """The grains of a run. Until the next record, `advance` repeats: leave a stop, move to the next stop, examine it.

    `here` is the start of the next step of the path; `step` is the current step of the path
    and `number` its number. `instant` is the Instant of a stop; no State stays in memory while the grains move.
    """

    step: Step
    loading: Loading
    instant: Instant
    stop_when: Condition | None

    def __init__(
        self,
        path: Path,
        recorder: Recorder,
        state: State,
        stored: StoredRun | None,
        options: Options,
        progress: Progress,
        signals: Signals,
        device: Device,
    ) -> None:
        """Prepare a run from a State or, if the run is resumed, from the stored run; nothing is loaded yet."""
        self.path, self.recorder, self.options = path, recorder, options
        self.progress, self.threads = progress, device.cores
        self.stopping = Stopping(signals, path, recorder, self.tell)
        self.cell = stored.first["cell"] if stored else state.cell
        point = stored.point if stored else Checkpoint(state, False, 0.0)
        self.began, self.spent = time.monotonic(), point.wall_time
        self.position, self.ratcheting, self.endings = point.position, point.ratcheting, point.endings
        self.last = stored.last if stored else {}
        self.facts = facts_of(path)
        self.at_start = point.state
        recorder.undrained_before = () if stored else state.undrained_stress
        if any(self.at_start.undrained_stress):
            start = np.reshape(self.at_start.undrained_stress, (3, 3))
            self.facts = dataclasses.replace(self.facts, reference=start)
        starts = stored.first["stress"] if stored else None, self.facts.reference if self.facts.undrained else None
        if stored and stored.about_zero:
            starts = mean_stress(stored.first["stress"]) * np.eye(3), None
        state, step_strain = self.at_start, rate_of(path) * state.time_step
        abilities = device.kind.abilities
        work = min(abilities.checkpoint_work, abilities.checkpoint_steps * state.number_of_grains)
        self.schedule = Schedule.of(path, state.time_step, state.number_of_grains, options, work)
        self.clock = PathClock(self.schedule, state.step, state.step, self.position.skipped, step_strain)
        self.here = Here(self.position.stress, step_strain, *starts)
        if stored:
            self.here.pores = float(stored.first["volume"]), float(stored.first["void_ratio"])
        self.number = -1
        self.is_checkpoint = self.stress_reached = False

    def run(self) -> Needs:
        """Carry the grains along the path from their current position."""
        state, schedule, options = self.at_start, self.schedule, self.options
        del self.at_start
        abilities: Abilities = yield Load(state)
        fresh = not self.recorder.records
        if fresh and not state.velocity_gradient.any():  # otherwise keep the state that the engine left
            state = yield reload
        self.instant = Instant(state)
        if fresh:
            self.here.stress = self.position.stress = yield lambda engine: engine.stress()
            self.here.first = self.instant.stress
            self.here.pores = self.instant.snapshot.volume, void_ratio(self.instant.snapshot)
        most = ahead(state.number_of_grains) if abilities.follow is not None else 1
        of_path = rate_of(self.path), state.time_step, options.servo
        self.loading = Loading(self.clock, *of_path, self.stopping, most, state.velocity_gradient)
        begun = schedule.firsts[min(schedule.span(self.clock.planned_step), len(schedule.firsts) - 1)]
        first = min(begun + self.position.step_in_span, schedule.path_steps - 1)
        self.stop_when = None
        if options.stop_when is not None:
            self.stop_when = condition(options.stop_when)
        del state  # no State stays in memory while the grains move
        yield from walk(self.path, self, schedule.path_steps, first, self.stop_when)

    def advance(self) -> Generator[Request, object, Stop]:
        """Follow the step of the path to its next record. Raises Interrupted, with the run saved, after a signal."""
        while True:
            if self.stopping.is_due(self.is_checkpoint):
                self.interrupt(self.instant.state)
            end, stiffness = self.leave()
            self.stress_reached = yield from self.loading.advance(end, self.step, stiffness)
            if self.clock.now < end and not self.stress_reached:
                self.clock.halt_early()
                state: Answer = yield lambda engine: engine.state()
                self.interrupt(state)
            self.clock.halt()
            self.position.step_in_span += self.stress_reached and self.step.length is None
            yield from self.examine()
            if self.is_last or self.stress_reached or self.schedule.is_record(self.clock.planned_step):
                return self.measure()

    def interrupt(self, state: State) -> NoReturn:
        """Save the run after a signal, and raise Interrupted."""
        signal = f"signal {self.stopping.signals.caught}"
        self.endings = self.endings.after(Ending(self.number + 1, Cause.SIGNAL, signal))
        self.recorder.save(self.checkpoint(state, False))
        raise self.stopping.error()

    def leave(self) -> tuple[int, np.ndarray | None]:
        """Leave a stop, writing a due checkpoint; return the time step of the next stop and the cell stiffness."""
        instant, clock, step = self.instant, self.clock, self.step
        self.loading.gradient = instant.state.velocity_gradient
        stiffness = None if step.held is None else instant.stiffness(step.held.components)
        if self.is_checkpoint:
            self.recorder.checkpoint(self.checkpoint(instant.state, False))
            self.is_checkpoint = False
        planned = self.schedule.next_stop(clock.planned_step) - clock.planned_step
        steps, clock.pace = steps_at(self.wanted_pace(), planned)
        del self.instant
        return clock.now + steps, stiffness

    def wanted_pace(self) -> float:
        """Return the pace at which the inertial number equals the option `inertial_number`; 1 without this option."""
        number, state, before = self.options.inertial_number, self.instant.state, self.clock.pace
        if number is None:
            return 1.0
        grains = 2.0 * float(state.body_radius.mean()), state.scene.density, float(mean_stress(self.instant.stress))
        expected = inertial_number_of(self.step, before * rate_of(self.path), self.accumulated_strain, *grains)
        return pace(number, expected / before)

    def examine(self) -> Needs:
        """Read the state at a stop from the engine."""
        self.recorder.wait()  # user code runs next and may open files
        self.is_checkpoint = self.schedule.is_checkpoint(self.clock.planned_step, self.is_last)
        state = yield (reload if self.is_checkpoint else lambda engine: engine.state())
        if lattice.tilt(state.cell) > lattice.MOST_TILT:  # replace the cell by an equivalent one
            U = lattice.reduction(state.cell)
            self.position.lattice = self.position.lattice @ U
            state = lattice.in_cell(state, U)
            yield Load(state)
        self.instant = Instant(state)

    @property
    def accumulated_strain(self) -> float:
        return self.clock.accumulated_strain

    @property
    def is_last(self) -> bool:
        """True if the path is over: all its time steps are made, or the stress that ends its last step is reached."""
        return self.is_ended_by_stress or self.clock.planned_position == self.schedule.steps

    @property
    def is_ended_by_stress(self) -> bool:
        """True if the stress that ends the last step of the path is reached."""
        return self.stress_reached and self.number + 1 == self.schedule.path_steps

    def enter(self, number: int, step: Step) -> None:
        span = self.schedule.span_of(number)
        if self.number >= 0:
            within = number - self.schedule.firsts[span]
            self.position = Position(within, self.position.lattice, stress=self.here.stress)
        self.clock.enter(span, step.programme is not None)
        self.number, self.step = number, step
        if not self.recorder.records:
            start = self.measure()
            self.cell = np.asarray(start.record["cell"])
            self.drain(step, start.record["stress"])
            self.arrive(start, None)
            require_false_at_start(self.stop_when, start.record, self.facts)
            self.recorder.save(self.checkpoint(self.instant.state, False))
        else:
            self.drain(step, self.last["stress"])

    def measure(self) -> Stop:
        """Return the Stop with the record at this stop, and whether the step or the walk ends here."""
        values = self.instant.measure(self.cell @ self.position.lattice)
        if self.step.programme is not None:
            values |= self.step.programme.progress(self.accumulated_strain)
        if self.options.inertial_number is not None:
            values["accumulated_strain"] = self.clock.step_strain * self.clock.planned_position
        at_end, by_stress = self.clock.is_at_end_of_span, self.step.length is None
        if self.stress_reached:
            return Stop(values, Cause.STRESS)
        return Stop(values, (Cause.LIMIT if by_stress else Cause.STRAIN) if at_end else None)

    def lost(self, record: Record) -> str:
        if not self.options.guarded or not self.recorder.records:
            return ""
        return too_thin(self.instant.state) or self.why_lost(self.instant.state, np.asarray(record["stress"]))

    def arrive(self, stop: Stop, ending: Ending | None) -> None:
        state, values, recorder = self.instant.state, dict(stop.record), self.recorder
        require_sane(values, state.step)
        if self.replaces_last():
            recorder.drop_last()
        self.ratcheting.add(recorder.records, state.time, ratcheting_power(state, self.instant.snapshot))
        if self.options.guarded:
            require_balanced(state, None, values["energy_balance_error"] + self.ratcheting.error(state))
        last = ending is not None and ending.over
        is_wanted = self.schedule.is_snapshot(recorder.records, last) or self.is_kept_turn()
        recorder.record(values, self.instant.snapshot if is_wanted else None)
        self.position.regular, self.last = ending is None and recorder.records > 1, values
        self.endings = self.endings.after(ending)
        text = status_of(self.path, values, self.number, self.schedule.path_steps)
        is_lost = ending is not None and ending.cause is Cause.LOST
        if last and not is_lost:
            self.progress(1.0, text)
        else:
            self.tell(text)
        if last:
            recorder.save(self.checkpoint(state, not is_lost))
        if is_lost:
            raise unfinished_error(self.endings.reason, recorder.output)

    def replaces_last(self) -> bool:
        """Return True if the record at the stress that ends the path replaces the last record.

        The last record is then a regular one, less than half an interval before, without contacts. The record at a
        reversal, or at the end of a step, is always kept.
        """
        if not (self.is_ended_by_stress and self.position.regular):
            return False
        close = self.schedule.is_close_to_record(self.clock.planned_step)
        return close and not self.schedule.is_snapshot(self.recorder.records - 1, last=False)

    def tell(self, text: str) -> None:
        """Report the progress, with a text."""
        in_span = self.position.step_in_span / self.schedule.path_steps
        self.progress(max(self.clock.planned_position / self.schedule.steps, in_span), text)

    def is_kept_turn(self) -> bool:
        """Return True if the record at a reversal triggered by stress is stored with all contacts.

        At most `snapshots` of these records are stored with their contacts.
        """
        number = self.options.snapshots
        turned = self.stress_reached and self.step.length is None
        return turned and bool(number) and self.position.step_in_span % -(-self.schedule.path_steps // number) == 0

    def why_lost(self, state: State, stress: np.ndarray) -> str:
        """Say why a held stress can no longer reach its target; empty if it can. `stress` (3, 3) in Pa."""
        step, programme, rate = self.step, self.step.programme, self.clock.pace * rate_of(self.path)
        reason = "" if programme is None else programme.why_lost(stress, self.accumulated_strain)
        if reason or step.held is None:
            return reason
        limit, prescribed = rate * step.rate_limit, rate * step.rates(self.accumulated_strain)
        here = stress, self.accumulated_strain, self.instant.snapshot.volume
        error = float(errors(step.held, *here).max())
        strain = limit / self.clock.pace * state.time_step * self.schedule.steps_per_record
        at_limit = error > ERROR and is_at_limit(step.held, -state.velocity_gradient, prescribed, limit)
        self.position.lag = self.position.lag.after(strain, error, at_limit)
        if not self.position.lag.hopeless:
            return ""
        label = "" if programme is None else programme.label
        return label + unreachable(step.held, step.held.names, *here)

    def checkpoint(self, state: State, complete: bool) -> Checkpoint:
        """Return the Checkpoint of a State of this run."""
        seconds = self.spent + max(0.0, time.monotonic() - self.began)  # a restored virtual machine sets its clock back
        position = dataclasses.replace(self.position, skipped=self.clock.skipped)
        start = self.facts.reference
        state = state.replace(undrained_stress=() if start is None else tuple(np.ravel(start).tolist()))
        return Checkpoint(state, complete, seconds, self.threads, position, self.endings, self.ratcheting.copy())
