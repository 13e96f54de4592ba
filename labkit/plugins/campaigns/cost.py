"""The table that `labkit campaign --dry-run` prints: the jobs that are left, with their time and disk space."""

from __future__ import annotations

from collections.abc import Sequence

from labkit.paths.rates import on_grains
from labkit.plugins.campaigns.jobs import Job
from labkit.plugins.campaigns.layout import output_of
from labkit.process.progress import time_text
from labkit.records.limits import INERTIAL_LIMIT, expected_inertial_number, slower_rate

PRODUCT_SECONDS = 6.0  # time for the statistics and figure of a run; Python takes half of it to start


def cost_table(jobs: Sequence[Job], left: Sequence[Job], cores: int) -> str:
    """Return the table printed by `--dry-run`: the jobs that remain to be done (`left`), and their cost."""
    kinds = [job.kind for job in jobs]
    counts = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in ("specimen", "consolidation", "run"))
    if not left:
        return f"{counts}: all are finished, nothing is left to do"
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    ends = dict[str | None, float]()  # output of a job -> time at which it could end, s
    total = grain_steps = disk = 0.0
    for job in left:
        cost = job.cost
        seconds = cost.seconds() + (PRODUCT_SECONDS if job.path else 0.0)
        ends[output_of(job)] = ends.get(job.source, 0.0) + seconds
        total, grain_steps, disk = total + seconds, grain_steps + cost.grain_steps, disk + cost.disk
        numbers = f"{cost.grain_steps:>11.2e} {time_text(seconds):>9} {size_text(cost.disk):>9}"
        lines.append(f"{job.kind:<14} {job.name:<40} {job.device.name:<7} {numbers}")
    if len(left) < len(jobs):
        lines.append(f"{len(jobs) - len(left)} of {len(jobs)} jobs are finished; this is what is left")
    expected = max(total / cores, *ends.values())
    lines += [
        f"{counts}: {grain_steps:.3g} grain-steps",
        f"about {time_text(expected)} on {cores} cores, {time_text(total)} on one "
        f"(typical speeds); tests that end at a given stress take less",
        f"about {size_text(disk)} of disk space",
        *rate_warnings(left),
    ]
    return "\n".join(lines)


def rate_warnings(jobs: Sequence[Job]) -> list[str]:
    """Return a warning, if any, about runs whose rates will make their inertial numbers exceed the limit.

    A run at the pressure of its specimen, which may not exist yet, is left out.
    """
    fast = list[tuple[float, float, str]]()
    for job in jobs:
        pressure = None if job.path is None else job.path.start_pressure()
        number = job.options.inertial_number
        if job.path is not None and number is None and pressure is not None:
            path = on_grains(job.path, job.scene)
            number = expected_inertial_number(path, job.scene, pressure)
            if number > INERTIAL_LIMIT:
                fast.append((number, slower_rate(path, number), job.name))
        elif number is not None and number > INERTIAL_LIMIT:
            fast.append((number, float("nan"), job.name))
    if not fast:
        return []
    (least, *_), (most, slowest, name) = min(fast), max(fast)
    numbers = f"{least:.2g}" if len(fast) == 1 else f"{least:.2g} to {most:.2g}"
    cure = f"reduce the rate, for {name} to {slowest:.2g} 1/s" if slowest == slowest else f"reduce it, e.g. for {name}"
    return [
        f"warning: the inertial number of {len(fast)} of the runs will be about {numbers}, above the limit "
        f"{INERTIAL_LIMIT:g} for quasi-static tests: {cure}, or give inertial_number: 2e-4"
    ]


def size_text(size: float) -> str:
    """Format a number of bytes with a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"
