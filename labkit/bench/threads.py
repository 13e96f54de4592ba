"""Speed of the fused engine on one and on several threads, with the other cores free and busy."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator

from labkit.dem.engine import Progress
from labkit.engines import die_with_parent
from labkit.engines.speed import speed


@contextlib.contextmanager
def busy_cores(count: int) -> Iterator[None]:
    """Context manager that keeps `count` processes busy computing."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command, preexec_fn=die_with_parent) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def threads(specimen: str, steps: int, rounds: int, progress: Progress) -> str:
    """Tabulate the steps per second on one and on several threads, as medians of alternating rounds.

    The ratio is relative to one thread under the same conditions; it is the median of the ratios of the individual
    rounds.
    """
    cores = os.cpu_count() or 1
    counts, conditions = sorted({1, cores}), {"other cores free": 0, "other cores busy": max(1, cores - 1)}
    measured: dict[tuple[str, int], list[float]] = {(name, count): [] for name in conditions for count in counts}
    for turn in range(rounds):
        for number, (name, count) in enumerate(measured):
            progress((turn * len(measured) + number) / (rounds * len(measured)), f"{count} threads, {name}")
            with busy_cores(conditions[name]):
                measured[name, count].append(speed("fused", specimen, steps, count)["steps_per_second"])
    progress(1.0, "done")
    lines = [f"{'':<30} {'steps/s':>9} {'ratio':>7} {'range':>13}"]
    for (name, count), speeds in measured.items():
        ratios = [several / one for several, one in zip(speeds, measured[name, 1], strict=True)]
        label = f"{count} thread{'s' * (count > 1)}, {name}"
        line = f"{label:<30} {statistics.median(speeds):9.1f} {statistics.median(ratios):7.2f} "
        lines.append(line + f"{min(ratios):6.2f}-{max(ratios):<6.2f}")
    return "\n".join(lines)
