"""Consolidation of a specimen at rest to the initial pressure of CR and CP, or to other stresses.

A periodic cell has six degrees of freedom, and a finite packing one stress for each. At a fixed shape the network of
contacts carries whatever shear stress it has: only a change of shape relaxes it. A free cell therefore changes all six
components of its shape until all six stresses are at their targets, or five at constant volume (`level_stress`).

The state of an unfinished consolidation is saved in a file, so that a killed command need not start again. A continued
and an uninterrupted consolidation end at the same stresses, but not in bitwise identical states, because loading a
state changes the order in which contact forces are summed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import time
from collections.abc import Generator
from pathlib import Path as File

import numpy as np

from labkit.engines.base import Load, Progress, Request, carry_out, silent
from labkit.engines.device import Device
from labkit.engines.kernel.sources import code_of_law
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.grains.state import State
from labkit.grains.state_file import read_state, write_state
from labkit.micro.indicators import unbalanced_force
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.paths.control import Control
from labkit.paths.path import Path
from labkit.paths.rates import on_grains, rate_of
from labkit.paths.standard import Levelling
from labkit.paths.step import Here, Step
from labkit.process.interruption import Signals, nothing_saved, require_owner, stop_on_signals
from labkit.process.progress import log_fraction
from labkit.records.energy import open_ledger, require_balanced
from labkit.servo.correction import STANDARD, cell_stiffness
from labkit.servo.plan import correcting_of, corrections_of
from labkit.specimens.ready import Answer, ready

TOLERANCE = 1e-3  # largest error of each held stress, relative to its target (see stress_error)
UNBALANCED = 1e-3
CHECK_INTERVAL = 250  # time steps
STEP_LIMIT = 200_000  # time steps to reach the stress
REST_LIMIT = 1_000_000  # time steps to come to rest at the stress; specimens without friction need many
PAUSE = 10.0  # s between two saves of an unfinished consolidation
SHARE = 0.05  # largest fraction of the time spent on saving


def stress_error(snapshot: Snapshot, control: Control) -> float:
    """Return the largest deviation of the stresses that a Control holds from their targets.

    It is relative to the target or, for a target of zero, to the mean normal stress of the contacts.
    """
    stress, target = to_six(symmetric(love_stress(snapshot))), control.at(0.0)
    scale = np.where(target == 0.0, contact_stress(snapshot), np.abs(target))
    return float((np.abs(control.measure @ stress - target) / scale).max())


def contact_stress(snapshot: Snapshot) -> float:
    """Return the mean of |b . f| over the contacts as a pressure, Pa: the mean stress, if no contact is in tension."""
    work = np.einsum("ci,ci->c", snapshot.contacts.branch(snapshot.radius), snapshot.force_on_first)
    return max(float(np.abs(work).sum() / (3.0 * snapshot.volume)), np.finfo(float).tiny)


def level_stress(state: State, unbalanced: float, device: Device, progress: Progress = silent) -> State:
    """Return a specimen at rest, sheared at constant volume until its stress is isotropic.

    A specimen without contacts is returned as it is. Raises PhysicsError at the step limit.

    Args:
        state: Specimen at rest.
        unbalanced: Largest unbalanced force of the result.
        device: Creates the engine.
        progress: Function that is called with the completed fraction and a text.
    """
    if len(state.contact_grain) == 0:
        return state
    return device.drive(approach(state, Levelling(), device, progress, None, Signals(), unbalanced))


def bring_to(
    specimen: State, path: Path, device: Device, progress: Progress = silent, interim: File | None = None
) -> State:
    """Return a State at rest in which the stresses that `path` holds are at their targets.

    Raises PhysicsError at the step limit, and Interrupted after a signal; an interim file is written first.

    Args:
        specimen: State at rest.
        path: Path that holds stresses.
        device: Creates the engine.
        progress: Function that is called with the completed fraction and a text.
        interim: File in which the state is saved regularly, so that an interrupted consolidation can be continued.
    """
    with stop_on_signals() if interim is not None else contextlib.nullcontext(Signals()) as signals:
        return device.drive(approach(specimen, path, device, progress, interim, signals))


def approach(
    specimen: State,
    path: Path,
    device: Device,
    progress: Progress,
    interim: File | None,
    signals: Signals,
    unbalanced: float = UNBALANCED,
    guarded: bool = True,
) -> Generator[Request, Answer, State]:
    """Yield the requests of `bring_to` to the engine of a device (labkit.engines.base); stops at a signal.

    The grains are at rest when their unbalanced force is below `unbalanced`. If `guarded` is False, the time step and
    the energy balance do not stop the consolidation.
    """
    path = on_grains(path, specimen.scene)
    control = path.control()
    if control is None:
        raise InputError(f"path {path.name} holds no stress: choose a path that does")
    saved = Interim(interim, specimen, path, device)
    state = saved.resume()
    begin = state.step if state else 0
    abilities = yield Load(state or open_ledger((yield from ready(specimen.at_rest(), guarded))))
    held, rate = next(iter(path.steps_from(Here()))), rate_of(path)
    first = max(stress_error(specimen.snapshot(), control), 2 * TOLERANCE)
    for step in range(begin, REST_LIMIT, CHECK_INTERVAL):
        state = yield lambda engine: engine.state()
        saved.keep(state, signals)
        snapshot = state.snapshot()
        if guarded:
            require_balanced(state, snapshot)
        error = stress_error(snapshot, control)
        progress(log_fraction(first, error, TOLERANCE), f"{path.name}, error of stress {error:.2%}")
        force = unbalanced_force(snapshot)
        if step and error < TOLERANCE and force < unbalanced:
            saved.remove()
            return state.at_rest()
        if step >= STEP_LIMIT and error >= TOLERANCE:
            break
        yield from advance_along(held, rate, state, snapshot, CHECK_INTERVAL, abilities.follow is not None)
    when = f"{step} steps (off by {error:.1%}, unbalanced force {force:.2g})"
    if error < TOLERANCE:
        advice = "increase the friction or local_damping, or choose a larger stress"
        raise PhysicsError(f"the specimen reached its stresses, but did not come to rest in {when}: {advice}")
    raise PhysicsError(_why_missed(path, control, when))


def advance_along(
    step: Step, rate: float, state: State, snapshot: Snapshot, steps: int, follows: bool
) -> Generator[Request, Answer, None]:
    """Yield the requests that advance a state by at least one interval of the servo along a step that holds stresses.

    Args:
        step: The step of a path.
        rate: Strain rate of the path, 1/s.
        state: Current state of the engine.
        snapshot: Its snapshot, from which the stiffness of the cell follows.
        steps: Time steps.
        follows: True if the engine runs the servo.
    """
    if step.held is None:
        raise InputError("the step holds no stress: choose a path that does")
    stiffness = cell_stiffness(snapshot, step.held.components)
    servo = correcting_of(step, rate, stiffness, state.time_step, STANDARD)
    rows = max(steps // STANDARD.interval, 1)
    corrections = corrections_of(step, rate, state.time_step, servo, [STANDARD.interval] * rows, [0.0] * rows)
    yield from carry_out(corrections, state.time_step, state.velocity_gradient, follows)


def _why_missed(path: Path, control: Control, when: str) -> str:
    """Say that a path did not reach the stresses that its Control holds within so many steps, and what to do."""
    if isinstance(path, Levelling):
        return (
            f"the stress of the specimen did not become isotropic in {when}: decrease the void ratio or increase "
            "step1_friction, so that the specimen carries load, or give cell = fixed, which keeps the shear stresses"
        )
    instead = ", or cell = fixed, which keeps the shear stresses" if control.triangular else ""
    targets = np.array2string(control.at(0.0), precision=4)
    return f"the specimen did not reach {targets} Pa in {when}: choose a stress closer to the current one{instead}"


class Interim:
    """Saves intermediate states to a file while a specimen is consolidated along a path.

    If `file` is None, nothing is saved.
    """

    def __init__(self, file: File | None, specimen: State, path: Path, device: Device) -> None:
        """Prepare to save; no file is opened yet."""
        self.file = file
        engine = [device.name, device.precision, code_of_law(specimen.scene)]
        aim = [specimen.digest(), path.name, dataclasses.asdict(path), *engine]
        self._key = hashlib.sha256(json.dumps(aim).encode()).hexdigest()
        self._specimen, self._owner = specimen, os.getpid()
        self._saved, self._took = time.monotonic(), 0.0

    def resume(self) -> State | None:
        """Return the last saved state of the same consolidation, or None."""
        if self.file is None or not self.file.exists():
            return None
        try:
            state = read_state(self.file)
        except InputError:  # damaged, or from another version: start again
            return None
        if state.history != self._key:
            return None
        specimen = self._specimen
        return state.replace(history=specimen.history, recipe=specimen.recipe, provenance=specimen.provenance)

    def keep(self, state: State, signals: Signals) -> None:
        """Save a state if a save is due. Raises Interrupted, after saving the state, if a signal was caught."""
        if self.file is None:
            if signals.caught:
                raise nothing_saved(signals.caught)
            return
        now = time.monotonic()
        if not signals.caught and 0.0 <= now - self._saved <= max(PAUSE, self._took / SHARE):
            return
        write_state(self.file, state.replace(history=self._key, recipe="", provenance=""))
        self._saved, self._took = time.monotonic(), time.monotonic() - now
        if signals.caught:
            raise Interrupted(
                f"stopped by signal {signals.caught}; {self.file} keeps the consolidation so far: give the same "
                "command to continue it",
                128 + signals.caught,
            )

    def remove(self) -> None:
        """Delete the file, because the consolidation is complete."""
        require_owner(self._owner)
        if self.file is not None:
            self.file.unlink(missing_ok=True)


def interim_of(output: File | str | None) -> File | None:
    """Return the path of the interim file of a command that writes `output`."""
    return None if output is None else File(output).with_name(f".{File(output).name}.consolidation")
