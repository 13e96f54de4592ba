"""Speed of the fused engine on one thread and on several, with the other cores free or busy."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from functools import partial

from benchmarks.rounds import alternate, ratio
from benchmarks.speed import speed
from labkit.engines.base import Progress
from labkit.process.children import die_with_parent


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

    def measure(count: int, busy: int) -> float:
        with busy_cores(busy):
            return speed("fused", specimen, steps, count)["steps_per_second"]

    labels = {(name, count): f"{count} thread{'s' * (count > 1)}, {name}" for name in conditions for count in counts}
    measures = {label: partial(measure, count, conditions[name]) for (name, count), label in labels.items()}
    measured = alternate(measures, rounds, progress)
    lines = [f"{'':<30} {'steps/s':>9} {'ratio':>7} {'range':>13}"]
    for (name, _), label in labels.items():
        speeds = measured[label]
        lines.append(f"{label:<30} {statistics.median(speeds):9.1f} {ratio(speeds, measured[labels[name, 1]])}")
    return "\n".join(lines)
