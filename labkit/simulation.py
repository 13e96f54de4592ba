"""Joins specimen, path, engine and recorder: one run, continued if it was begun."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from labkit.engines import start_engine
from labkit.errors import InputError, PhysicsError
from labkit.measure import measure
from labkit.micro.contacts import contacts_of
from labkit.micro.stress import mean_stress
from labkit.paths import velocity_gradient
from labkit.recorder import Recorder
from labkit.timestep import critical_time_step

RECORD_STRAIN = 1e-3  # between two records
SNAPSHOTS = 20
CHECKPOINT_GRAIN_STEPS = 40_000_000  # between two saves: half a minute of YADE


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Which steps are recorded, which of the records are snapshots, and after which the file is saved."""

    steps: int  # of the whole run
    steps_per_record: int
    records_per_snapshot: int
    records_per_save: int

    @classmethod
    def of(cls, path, time_step, grains, record_strain, snapshots):
        """Records every `record_strain` of axial strain, `snapshots` + 1 of them with all contacts."""
        step_strain = path.rate * time_step
        steps = max(1, round(path.strain / step_strain))
        per_record = min(steps, max(1, round(record_strain / step_strain)))
        records = -(-steps // per_record)
        return cls(
            steps=steps,
            steps_per_record=per_record,
            records_per_snapshot=max(1, round(records / snapshots)) if snapshots else records,
            records_per_save=max(1, round(CHECKPOINT_GRAIN_STEPS / (grains * per_record))),
        )

    def next_record(self, step):
        return min(self.steps, (step // self.steps_per_record + 1) * self.steps_per_record)

    def is_snapshot(self, record, step):
        return record % self.records_per_snapshot == 0 or step == self.steps

    def is_save(self, record, step):
        return record % self.records_per_save == 0 or step == self.steps


def run(specimen, path, file, engine="yade", threads=1, record_strain=RECORD_STRAIN, snapshots=SNAPSHOTS,
        progress=lambda fraction, text: None):  # fmt: skip
    """Takes a specimen along a path and records it in a run file; goes on with a file that is unfinished.

    Returns False when the file held the finished run already. Raises InputError for a file with another
    run, PhysicsError when the simulation fails.
    """
    recorder = Recorder(file, path, {"record_strain": record_strain, "snapshots": snapshots, "engine": engine})
    begun = recorder.resume()
    if begun and begun[2]:
        return False
    if begun:
        state, wall_before = begun[0], begun[1]
        require_same_specimen(state, specimen, file)
    else:
        state, wall_before = specimen.at_rest().replace(time_step=specimen.scene.time_step, engine=engine), 0.0
        require_stable(state)
    schedule = Schedule.of(path, state.time_step, state.number_of_grains, record_strain, snapshots)
    started = time.monotonic()
    machine = start_engine(engine, state, threads)

    def record(state):
        contacts = contacts_of(state)
        values = measure(state, specimen.cell, contacts)
        require_sane(values, state)
        snapshot = schedule.is_snapshot(recorder.records, state.step)
        recorder.record(values, *((contacts, state.position) if snapshot else ()))
        progress(state.step / schedule.steps, _status(values))

    def save(state):
        recorder.save(state, state.step == schedule.steps, wall_before + time.monotonic() - started)

    if not begun:
        state = machine.reload()
        record(state)
        save(state)
    while state.step < schedule.steps:
        gradient = velocity_gradient(path.strain_rate(), state.time_step)
        machine.advance(schedule.next_record(state.step) - state.step, gradient)
        saving = schedule.is_save(recorder.records, schedule.next_record(state.step))
        state = machine.reload() if saving else machine.state()
        record(state)
        if saving:
            save(state)
    return True


def _status(values):
    return f"strain {values['axial_strain']:.2%}, p {mean_stress(values['stress']) / 1e6:.3f} MPa"


def require_stable(state):
    """Raises PhysicsError when the time step is beyond the stability limit of the state."""
    limit = critical_time_step(state)
    if state.time_step > limit:
        raise PhysicsError(
            f"the time step {state.time_step:.3g} s is beyond the stable {limit:.3g} s: "
            f"lower time_step_factor from {state.scene.time_step_factor:g}"
        )


def require_sane(values, state):
    """Raises PhysicsError when a record shows that the integration has run away."""
    if not (np.all(np.isfinite(state.position)) and np.isfinite(values["kinetic_energy"])):
        raise PhysicsError(f"positions are no numbers any more at step {state.step}: the time step is too large")


def require_same_specimen(state, specimen, file):
    """Raises InputError when a run was begun with another specimen."""
    same = state.scene == specimen.scene and np.array_equal(state.radius, specimen.radius)
    if not same:
        raise InputError(f"{file} was begun with another specimen: give another -o")
