"""Cost of a campaign or of a single command: grain-steps, time, memory and disk space.

Time follows from the speeds of labkit.campaigns.speeds. The number of steps that a specimen takes is a typical count;
it does not depend on the computer.
"""

from __future__ import annotations

import dataclasses
import functools
import heapq
from collections.abc import Mapping, Sequence

from labkit.campaigns.file import Campaign
from labkit.campaigns.folder import output_of
from labkit.campaigns.runs import MOST_RUNS, TYPICAL_PRESSURE, schedule_of
from labkit.campaigns.speeds import Speed, speed_of, supports
from labkit.engines.fused import was_compiled
from labkit.grains.scene import Scene
from labkit.io.progress import time_text
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path, holds_stress
from labkit.paths.rates import on_grains
from labkit.paths.step import Here
from labkit.records.schedule import Options
from labkit.runs.run.jobs import Job
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
class Work:
    """The work of a job or a command: `servo` is the number of steps between two stress sums, or None."""

    grains: int
    steps: float
    records: float = 0.0
    servo: int | None = None

    def seconds(self, speed: Speed, threads: int) -> float:
        """Time on an engine, s; records and the servo's stress sums count as steps."""
        servo = 0.0 if self.servo is None else speed.stress_steps / self.servo
        steps = self.steps * (1.0 + servo) + self.records * speed.record_steps
        return speed.start + steps * (speed.step + speed.grain_step * self.grains) / threads


def work_of(task: Task[object] | Job) -> Work:
    """Return the work of a task or a job, approximately for a specimen or a consolidation."""
    if isinstance(task, Job):
        grains, scene, path = task.grains, task.scene, task.path
    elif isinstance(task, SpecimenTask):
        grains, scene, path = task.recipe.expected_grains(task.material), task.material, None
    else:
        assert isinstance(task, (ConsolidationTask, RunTask))
        path = task.path if isinstance(task, RunTask) else None
        grains, scene = task.state.number_of_grains, task.scene
    if isinstance(task, SpecimenTask) or (isinstance(task, Job) and task.recipe):
        usual = scene.replace(grading=None, diameter_spread=Scene.diameter_spread)
        return Work(grains, round(SPECIMEN_STEPS * usual.time_step / scene.time_step))  # more for a wide grading
    if path is None:
        return Work(grains, CONSOLIDATION_STEPS)
    assert isinstance(task, (RunTask, Job))
    pressure = path.start_pressure() or TYPICAL_PRESSURE
    if isinstance(task, RunTask) and path.start_pressure() is None:
        pressure = float(mean_stress(love_stress(task.state.snapshot())))
    return _work_of_run(path, scene, task.options, grains, pressure)


@functools.lru_cache(MOST_RUNS)
def _work_of_run(path: Path, scene: Scene, options: Options, grains: int, pressure: float) -> Work:
    """Return the work of a run at a mean stress of `pressure`, Pa; the planned steps are those at a pace of one."""
    schedule = schedule_of(path, scene, grains, options)
    path = on_grains(path, scene).starting_at(pressure)
    servo = options.servo.interval if holds_stress(path) else None
    records = schedule.steps / schedule.steps_per_record
    return Work(grains, schedule.steps / expected_pace(path, options, scene, pressure), records, servo)


def cost_of(job: Job, speeds: Mapping[str, Speed]) -> Cost:
    """Estimate the Cost of a job from speeds, engine -> Speed; for a path that ends at a stress, an upper bound."""
    work, device = work_of(job), job.device
    base, each = MEMORY.get(device.name, OTHER_MEMORY)
    disk = STATE_BYTES * work.grains + work.records * RECORD_BYTES
    if job.path is not None:
        disk += (job.options.snapshots + 1) * work.grains * SNAPSHOT_BYTES
    seconds = work.seconds(speed_of(device.name, speeds), device.threads)
    return Cost(round(work.steps) * work.grains, seconds, base + each * work.grains, disk)


def expected_seconds(jobs: Sequence[Job], costs: Mapping[str, Cost], cores: int) -> float:
    """Estimate the time of jobs, s; a job starts once the job that it needs is done and a core is free.

    `costs` are those of the jobs, by output.
    """
    free = [0.0] * cores
    done: dict[str, float] = {}
    runs = [job for job in jobs if job.kind == "run"]
    others = [job for job in jobs if job.kind != "run"]
    for job in (*others, *sorted(runs, key=lambda run: -costs[output_of(run)].seconds)):
        start = max(heapq.heappop(free), done.get(job.source or "", 0.0))
        done[output_of(job)] = start + costs[output_of(job)].seconds
        heapq.heappush(free, done[output_of(job)])
    return max(free) + len(runs) * PRODUCT_SECONDS / cores


def cost_table(campaign: Campaign, left: Sequence[Job], speeds: Mapping[str, Speed], cores: int, origin: str) -> str:
    """Return the table printed by `--dry-run`: the jobs that are `left`, their cost, and the number of all.

    `origin` says where the speeds come from.
    """
    runs = [job for job in left if job.kind == "run"]
    counts = (
        f"{len(campaign.specimens)} specimens, {len(campaign.consolidations)} consolidations, {len(campaign.runs)} runs"
    )
    if not left:
        return f"{counts}: all are finished, nothing is left to do"
    costs = {output_of(job): cost_of(job, speeds) for job in left}
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    for job in left:
        cost = costs[output_of(job)]
        numbers = f"{cost.grain_steps:>11.2e} {time_text(cost.seconds):>9} {size_text(cost.disk):>9}"
        lines.append(f"{job.kind:<14} {job.name:<40} {job.device.name:<7} {numbers}")
    total = sum(cost.seconds for cost in costs.values()) + len(runs) * PRODUCT_SECONDS
    done = len(campaign.jobs) - len(left)
    lines += [f"{done} of {len(campaign.jobs)} jobs are finished; this is what is left"] * bool(done)
    return "\n".join(
        [
            *lines,
            f"{counts}: {sum(cost.grain_steps for cost in costs.values()):.3g} grain-steps",
            f"about {time_text(expected_seconds(left, costs, cores))} on {cores} cores, {time_text(total)} on one "
            f"({origin}); tests that end at a given stress take less",
            f"about {size_text(sum(cost.disk for cost in costs.values()))} of disk space",
        ]
    )


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
    line = f"{engine.name}, {about}{work.grains:,} grains, {about}{round(work.steps):,} steps{most}{done}"
    seconds, fused = (left * work.seconds(speed_of(name), engine.threads) for name in (engine.name, "fused"))
    if engine.name == "fused" and not was_compiled(task.scene, engine.precision):
        line += f", about {rough_time(seconds + COMPILATION)} with {COMPILATION:.0f} s to compile the contact law, once"
    else:
        line += f", about {rough_time(seconds)}"
    if seconds > ENDLESS:
        return f"{line}: it cannot finish in {rough_time(ENDLESS)}; give fewer grains, less strain or a higher rate"
    if engine.name == "fused" or seconds < MUCH_FASTER * fused or not supports("fused", task.scene):
        return line
    return f"{line}; with --engine fused about {rough_time(fused)}"


def rough_time(seconds: float) -> str:
    """Format a time in s, rounded, in a single unit."""
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds > DAYS:
        return f"{seconds / 86400.0:,.0f} days"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.3g} h"
