"""The table that `labkit campaign --dry-run` prints: the jobs that are left, with their time and disk space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from labkit.campaigns.layout import output_of
from labkit.io.progress import time_text
from labkit.runs.run.cost import Speed, cost_of
from labkit.runs.run.jobs import Job

PRODUCT_SECONDS = 6.0  # time for the statistics and figure of a run; Python takes half of it to start


def cost_table(jobs: Sequence[Job], left: Sequence[Job], speeds: Mapping[str, Speed], cores: int, origin: str) -> str:
    """Return the table printed by `--dry-run`: the jobs that remain to be done (`left`), and their cost.

    `origin` says where the speeds come from.
    """
    kinds = [job.kind for job in jobs]
    counts = ", ".join(f"{kinds.count(kind)} {kind}s" for kind in ("specimen", "consolidation", "run"))
    if not left:
        return f"{counts}: all are finished, nothing is left to do"
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    ends = dict[str | None, float]()  # output of a job -> time at which it could end, s
    total = grain_steps = disk = 0.0
    for job in left:
        cost = cost_of(job)
        seconds = cost.seconds(speeds) + (PRODUCT_SECONDS if job.path else 0.0)
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
        f"({origin}); tests that end at a given stress take less",
        f"about {size_text(disk)} of disk space",
    ]
    return "\n".join(lines)


def size_text(size: float) -> str:
    """Format a number of bytes with a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"
