"""Cost of a task: grain-steps, time, memory and disk space.

Time is computed from a table of typical speeds, or from measured speeds. The number of time steps for a specimen is a
typical value, which does not depend on the computer.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import NamedTuple

from labkit.engines.device import Device
from labkit.engines.fused import was_compiled
from labkit.grains.scene import Scene
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path, holds_stress
from labkit.paths.rates import on_grains
from labkit.paths.step import Here
from labkit.records.schedule import SNAPSHOT_BYTES, Options, Schedule
from labkit.simulation.clock import expected_pace
from labkit.simulation.tasks import AnyTask, ConsolidationTask, RunTask, SpecimenTask
from labkit.specimens.fabric import SIGNS
from labkit.specimens.recipe import Recipe

TYPICAL_PRESSURE = 0.5e6  # Pa, assumed if the pressure of a specimen is unknown before it is made

SPECIMEN_STEPS, CONSOLIDATION_STEPS = 10_000, 3_000  # typical; observed: 6,000 to 12,000 and 500 to 3,500
TYPICAL_TRIALS = 5  # compressions of a bisection
PRE_SHEARED = 2.5  # time steps of a specimen that is sheared and brought back, relative to an isotropic specimen
MEMORY = {"yade": (350, 0.02)}  # MB per process, and per grain
OTHER_MEMORY = (450, 0.02)
CONTACTS_PER_GRAIN = 2.8
RECORD_BYTES = 60 * 8
STATE_BYTES = 13 * 8 + CONTACTS_PER_GRAIN * 68
DAYS = 10 * 86400.0  # s; a longer time is given in days
ENDLESS = 30 * 86400.0  # s; a command that takes longer is announced as one that cannot finish
COMPILATION = 5.0  # s; the fused engine compiles each contact law once
MUCH_FASTER = 3.0  # least speed ratio at which a command suggests the fused engine


class Speed(NamedTuple):
    """Speed of one engine on one thread.

    Args:
        start: Time to start, s.
        step: Time per step, s.
        grain_step: Time per grain and step, s.
        record_steps: Cost of a record, in equivalent steps.
        stress_steps: Cost of a stress evaluation for the servo, in equivalent steps.
    """

    start: float
    step: float
    grain_step: float
    record_steps: float
    stress_steps: float


# Measured with benchmarks/speed.py on two cores of a Xeon at 2.8 GHz.
TYPICAL = {
    "fused": Speed(3.0, 1.2e-5, 4.3e-8, 45.0, 0.35),
    "yade": Speed(2.0, 0.0, 9.9e-7, 25.0, 0.4),
    "lammps": Speed(3.0, 3.7e-5, 4.3e-8, 45.0, 0.35),  # fused, and 25 us per step for LAMMPS
}


class Cost(NamedTuple):
    """Approximate cost of a job; `servo` is the number of time steps between stress evaluations of the servo."""

    device: Device
    grains: int
    steps: float
    records: float = 0.0
    servo: float = float("inf")
    snapshots: int = 0

    @property
    def grain_steps(self) -> float:
        """Steps times grains."""
        return self.steps * self.grains

    def seconds(self, speeds: Mapping[str, Speed] = TYPICAL) -> float:
        """Return the time, s, including records and stress evaluations; an unknown engine gets the lowest speed."""
        speed = speeds.get(self.device.name, TYPICAL["yade"])
        steps = self.steps * (1.0 + speed.stress_steps / self.servo) + self.records * speed.record_steps
        return speed.start + steps * (speed.step + speed.grain_step * self.grains) / self.device.cores

    @property
    def memory(self) -> float:
        """Memory, MB."""
        base, each = MEMORY.get(self.device.name, OTHER_MEMORY)
        return base + each * self.grains

    @property
    def disk(self) -> float:
        """Disk space, bytes."""
        return self.records * RECORD_BYTES + (STATE_BYTES + self.snapshots * SNAPSHOT_BYTES) * self.grains


def cost_of_specimen(recipe: Recipe, scene: Scene, device: Device, grains: int) -> Cost:
    """Return the estimated Cost of a specimen; `grains` is the number of spheres if the grains are clumps."""
    usual = scene.replace(grading=None, diameter_spread=Scene.diameter_spread)
    trials = TYPICAL_TRIALS if recipe.preparation == "bisection" else 1
    sheared = PRE_SHEARED if recipe.fabric in SIGNS else 1.0
    steps = trials * sheared * SPECIMEN_STEPS * usual.time_step / scene.time_step  # more steps for a wide grading
    return Cost(device, grains, steps)


@functools.lru_cache(10_000)
def cost_of_run(
    path: Path, scene: Scene, options: Options, device: Device, grains: int, pressure: float = TYPICAL_PRESSURE
) -> Cost:
    """Return the estimated Cost of a run, an upper bound for a path that ends at a stress.

    `pressure` is that of the specimen, Pa, for a path that starts at none of its own.
    """
    pressure = path.start_pressure() or pressure
    schedule = schedule_of(path, scene, grains, options)
    path = on_grains(path, scene).starting_at(pressure)
    steps, records = schedule.steps, schedule.steps / schedule.steps_per_record
    servo = options.servo.interval if holds_stress(path) else float("inf")
    slower = 1.0 / expected_pace(path, options, scene, pressure)
    return Cost(device, grains, slower * steps, records, servo, options.snapshots + 1)


@functools.lru_cache(10_000)
def schedule_of(path: Path, scene: Scene, grains: int, options: Options) -> Schedule:
    """Return the schedule of a run before its specimen exists. Raises InputError if rate and strain do not fit."""
    path = on_grains(path, scene).starting_at(TYPICAL_PRESSURE)
    return Schedule.of(path, scene.time_step, grains, options)


def announcement(task: AnyTask, steps_done: int = 0) -> str:
    """Announce engine, grains, steps and time of a task in one line; suggests the fused engine if it is much faster.

    `steps_done` is the number of completed steps of a run.
    """
    cost, engine = cost_of_task(task), task.device
    left = max(1.0 - steps_done / cost.steps, 0.0)
    done = f", {1.0 - left:.0%} of them done" if steps_done else ""
    most = " at most" if isinstance(task, RunTask) and next(iter(task.path.steps_from(Here()))).stress_ends else ""
    about = "" if isinstance(task, RunTask) else "about "
    line = f"{engine.name}, {about}{_contents(task, cost.grains)}, {about}{round(cost.steps):,} steps{most}{done}"
    seconds, fused = left * cost.seconds(), left * cost.seconds({engine.name: TYPICAL["fused"]})
    if engine.name == "fused" and not was_compiled(task.scene, engine.precision):
        line += f", about {rough_time(seconds + COMPILATION)} with {COMPILATION:.0f} s to compile the contact law, once"
    else:
        line += f", about {rough_time(seconds)}"
    if seconds > ENDLESS:
        return f"{line}: it cannot finish in {rough_time(ENDLESS)}; give fewer grains, less strain or a higher rate"
    if engine.name == "fused" or seconds < MUCH_FASTER * fused:
        return line
    return f"{line}; with --engine fused about {rough_time(fused)}"


def _contents(task: AnyTask, spheres: int) -> str:
    """Return the number of grains of a task, and of their spheres if they are clumps, as text."""
    if isinstance(task, SpecimenTask):
        grains = task.recipe.expected_grains(task.material)
    else:
        grains = len(task.state.body_radius)
    return f"{grains:,} grains" if grains == spheres else f"{grains:,} clumps of {spheres:,} spheres"


def cost_of_task(task: AnyTask) -> Cost:
    """Return the cost of a task."""
    if isinstance(task, SpecimenTask):
        grains = task.recipe.expected_spheres(task.material)
        return cost_of_specimen(task.recipe, task.scene, task.device, grains)
    grains = task.state.number_of_grains
    if isinstance(task, ConsolidationTask):
        return Cost(task.device, grains, CONSOLIDATION_STEPS)
    pressure = float(mean_stress(love_stress(task.state.snapshot())))
    return cost_of_run(task.path, task.scene, task.options, task.device, grains, pressure)


def rough_time(seconds: float) -> str:
    """Format a time in s, rounded, in a single unit."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds > DAYS:
        return f"{seconds / 86400.0:,.0f} days"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.3g} h"
