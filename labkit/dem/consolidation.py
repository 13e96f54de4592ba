"""Consolidation: brings a specimen at rest to a pressure before CR and CP, or to other stresses."""

from __future__ import annotations

import numpy as np

from labkit.dem import servo
from labkit.dem.energy import opened, require_balanced
from labkit.engines import start_engine
from labkit.errors import PhysicsError
from labkit.micro.contacts import contacts_of
from labkit.micro.indicators import unbalanced_force
from labkit.micro.stress import love_stress
from labkit.dem.paths import Consolidation
from labkit.io.progress import log_fraction
from labkit.dem.specimen import ready

TOLERANCE = 1e-3  # of the pressure, in each direction
UNBALANCED = 1e-3
CHECK_INTERVAL = 250  # steps
STEP_LIMIT = 200_000


def pressure_error(state, pressure):
    """Largest deviation of the three normal stresses from `pressure`, over it."""
    return stress_error(state, Consolidation(pressure).control())


def consolidate(specimen, pressure, engine="yade", threads=1, progress=lambda fraction, text: None):
    """A State at rest with the normal stresses at `pressure` (Pa). Raises PhysicsError at the step limit."""
    return bring_to(specimen, Consolidation(pressure), engine, threads, progress)


def stress_error(state, control):
    """Largest deviation of the stresses that a Control holds from their targets, over these."""
    stress = np.diag(love_stress(contacts_of(state), state.radius, state.volume))
    return float(np.abs(control.measure @ stress / control.target - 1.0).max())


def bring_to(specimen, path, engine="yade", threads=1, progress=lambda fraction, text: None):
    """A State at rest with the stresses that `path` holds at their targets. Raises PhysicsError at the step limit."""
    machine = start_engine(engine, opened(ready(specimen, engine, threads)), threads)
    control = path.control()
    first = max(stress_error(specimen, control), 2 * TOLERANCE)
    for step in range(0, STEP_LIMIT, CHECK_INTERVAL):
        state = machine.state()
        require_balanced(state)
        error = stress_error(state, control)
        progress(log_fraction(first, error, TOLERANCE), f"consolidation, stress off by {error:.2%}")
        unbalanced = unbalanced_force(state.number_of_grains, contacts_of(state))
        if step and error < TOLERANCE and unbalanced < UNBALANCED:
            return state.at_rest()
        stiffness, before = servo.cell_stiffness(state), state.velocity_gradient
        for _ in range(CHECK_INTERVAL // servo.STANDARD.interval):
            before = servo.velocity_gradient(path, 1.0, state.time_step, machine.stress(), stiffness, before)
            machine.advance(servo.STANDARD.interval, before)
    raise PhysicsError(
        f"the specimen does not reach {np.array2string(control.target, precision=4)} Pa in {STEP_LIMIT} steps "
        f"(off by {error:.1%}, unbalanced force {unbalanced:.2g}): choose a stress nearer to its own"
    )
