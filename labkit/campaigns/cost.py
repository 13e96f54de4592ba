"""Cost of a campaign or of a single command: grain-steps, time, memory and disk space.

Time follows from the speeds of labkit.campaigns.speeds. The number of steps that a specimen takes is a typical count;
it does not depend on the computer.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Mapping

from labkit.campaigns.items import TYPICAL_PRESSURE, Campaign, Consolidated, Item, PlannedRun
from labkit.campaigns.plan import Job, Plan
from labkit.campaigns.speeds import Speed, likely_speed, supports
from labkit.engines.fused import was_compiled
from labkit.grains.scene import Scene
from labkit.io.progress import time_text
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path, holds_stress
from labkit.paths.step import Here
from labkit.records.schedule import Options, Schedule
from labkit.runs.run.pace import expected_pace
from labkit.runs.run.tasks import ConsolidationTask, RunTask, SpecimenTask, Task

SPECIMEN_STEPS, CONSOLIDATION_STEPS = 10_000, 3_000  # typical: 6,000 to 12,000 and 500 to 3,500 were counted
PRODUCT_SECONDS = 6.0  # for statistics and figures of a run; half of this is the start of Python
MEMORY = {"yade": (350, 0.02)}  # MB per process, and per grain
OTHER_MEMORY = (450, 0.02)
CONTACTS_PER_GRAIN = 2.8
RECORD_BYTES = 60 * 8
SNAPSHOT_BYTES = 3 * 8 + CONTACTS_PER_GRAIN * 120  # per grain
STATE_BYTES = 13 * 8 + CONTACTS_PER_GRAIN * 68
DAYS = 10 * 86400.0  # s; a longer time is given in days
ENDLESS = 30 * 86400.0  # s; the announcement of a longer command says that it cannot finish
COMPILATION = 5.0  # s; compiling a contact law of the fused engine takes about five, once
MUCH_FASTER = 3.0  # speed ratio from which a command suggests the fused engine


@dataclasses.dataclass(frozen=True)
class Cost:
    """Approximate cost of one job: grain-steps, time in s on its threads, memory in MB, disk space in bytes."""

    grain_steps: float
    seconds: float
    memory: float
    disk: float


@dataclasses.dataclass(frozen=True)
class _Work:
    """The work of a job or a command.

    `slower` is the number of time steps of a run divided by the planned number; the two differ if the run has an
    inertial number. `servo` is the number of steps between two stress sums, or None.
    """

    grains: int
    planned_steps: int
    slower: float = 1.0
    records: float = 0.0
    servo: int | None = None

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return round(self.slower * self.planned_steps)

    def seconds(self, speed: Speed, threads: int) -> float:
        """Time on an engine, s; records and the servo's stress sums count as steps."""
        servo = 0.0 if self.servo is None else speed.stress_steps / self.servo
        steps = self.slower * self.planned_steps * (1.0 + servo) + self.records * speed.record_steps
        return speed.start + speed.seconds(steps, self.grains) / threads


def _of_run(path: Path, scene: Scene, options: Options, grains: int, pressure: float) -> _Work:
    """Return the work of a run at a mean stress of `pressure`, Pa."""
    schedule = Schedule.of(path, scene.time_step, grains, options)
    slower = 1.0 / expected_pace(path, options, scene, pressure)
    servo = options.servo.interval if holds_stress(path) else None
    return _Work(grains, schedule.steps, slower, schedule.steps / schedule.steps_per_record, servo)


def cost_of(job: Job, campaign: Campaign, speeds: Mapping[str, Speed]) -> Cost:
    """Estimate the Cost of a job from speeds, engine -> Speed; for a path that ends at a stress, an upper bound."""
    item = job.item
    origin = campaign.origin(_specimen_of(item))
    grains = origin.expected_grains
    base, each = MEMORY.get(item.engine, OTHER_MEMORY)
    work = _Work(grains, SPECIMEN_STEPS if job.kind == "specimen" else CONSOLIDATION_STEPS)
    disk = STATE_BYTES * grains
    if isinstance(item, PlannedRun):
        path = item.loading(origin)
        pressure = path.start_pressure() or TYPICAL_PRESSURE
        work = _of_run(path, item.scene(origin), item.options, grains, pressure)
        disk += work.records * RECORD_BYTES + (item.options.snapshots + 1) * grains * SNAPSHOT_BYTES
    seconds = work.seconds(speeds[item.engine], item.threads)
    return Cost(work.steps * grains, seconds, base + each * grains, disk)


def _specimen_of(item: Item) -> str:
    """Return the name of the specimen from which a job starts, or that it makes."""
    if isinstance(item, PlannedRun):
        return item.specimen
    return item.source if isinstance(item, Consolidated) else item.name


def expected_seconds(plan: Plan, costs: Mapping[Job, Cost], cores: int) -> float:
    """Estimate the time of the plan, s; a job starts once the jobs that it needs are done and a core is free."""
    free = [0.0] * cores
    done: dict[str, float] = {}
    for job in (*plan.specimens, *plan.consolidations, *sorted(plan.runs, key=lambda run: -costs[run].seconds)):
        start = max(heapq.heappop(free), done.get(job.source or "", 0.0))
        done[job.output] = start + costs[job].seconds
        heapq.heappush(free, done[job.output])
    return max(free) + len(plan.runs) * PRODUCT_SECONDS / cores


def cost_table(plan: Plan, speeds: Mapping[str, Speed], cores: int) -> str:
    """Return the table printed by `--dry-run`."""
    costs = {job: cost_of(job, plan.campaign, speeds) for job in plan.jobs}
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    for job in plan.jobs:
        cost = costs[job]
        numbers = f"{cost.grain_steps:>11.2e} {time_text(cost.seconds):>9} {size_text(cost.disk):>9}"
        lines.append(f"{job.kind:<14} {job.name:<40} {job.item.engine:<7} {numbers}")
    total = sum(cost.seconds for cost in costs.values()) + len(plan.runs) * PRODUCT_SECONDS
    lines += [
        f"{len(plan.specimens)} specimens, {len(plan.consolidations)} consolidations, {len(plan.runs)} runs: "
        f"{sum(cost.grain_steps for cost in costs.values()):.3g} grain-steps",
        f"about {time_text(expected_seconds(plan, costs, cores))} on {cores} cores, {time_text(total)} on one "
        "(speeds measured on this computer); tests that end at a given stress take less",
        f"about {size_text(sum(cost.disk for cost in costs.values()))} of disk space",
    ]
    return "\n".join(lines)


def size_text(size: float) -> str:
    """Format a number of bytes with a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"


def announcement(task: Task[object], steps_done: int = 0) -> str:
    """Announce engine, grains, steps and time of a task in one line; suggests the fused engine if it is much faster.

    `steps_done` is the number of completed steps of a run.
    """
    work, engine = work_of(task), task.device
    left = max(1.0 - steps_done / work.steps, 0.0)
    done = f", {1.0 - left:.0%} of them done" if steps_done else ""
    most = " at most" if isinstance(task, RunTask) and next(iter(task.path.steps_from(Here()))).stress_ends else ""
    about = "" if isinstance(task, RunTask) else "about "
    line = f"{engine.name}, {about}{work.grains:,} grains, {about}{work.steps:,} steps{most}{done}"
    seconds, fused = (left * work.seconds(likely_speed(name), engine.threads) for name in (engine.name, "fused"))
    if engine.name == "fused" and not was_compiled(task.scene, engine.precision):
        line += f", about {rough_time(seconds + COMPILATION)} with {COMPILATION:.0f} s to compile the contact law, once"
    else:
        line += f", about {rough_time(seconds)}"
    if seconds > ENDLESS:
        return f"{line}: it cannot finish in {rough_time(ENDLESS)}; give fewer grains, less strain or a higher rate"
    if engine.name == "fused" or seconds < MUCH_FASTER * fused or not supports("fused", task.scene):
        return line
    return f"{line}; with --engine fused about {rough_time(fused)}"


def work_of(task: Task[object]) -> _Work:
    """Return the work of a task, approximately for a specimen or a consolidation."""
    if isinstance(task, SpecimenTask):
        usual = task.material.replace(grading=None, diameter_spread=Scene.diameter_spread)
        steps = round(SPECIMEN_STEPS * usual.time_step / task.material.time_step)  # more for a wide grading
        return _Work(task.recipe.expected_grains(task.material), steps)
    assert isinstance(task, (ConsolidationTask, RunTask))
    grains = task.state.number_of_grains
    if isinstance(task, ConsolidationTask):
        return _Work(grains, CONSOLIDATION_STEPS)
    pressure = task.path.start_pressure() or float(mean_stress(love_stress(task.state.snapshot())))
    return _of_run(task.path, task.scene, task.options, grains, pressure)


def rough_time(seconds: float) -> str:
    """Format a time in s, rounded, in a single unit."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds > DAYS:
        return f"{seconds / 86400.0:,.0f} days"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.3g} h"
