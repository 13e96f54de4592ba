"""Speed and memory of computing the statistics of a run, for one snapshot in memory and for the whole file."""

from __future__ import annotations

import os
import statistics
import time
import tracemalloc
from collections.abc import Callable

import pandas

import labkit
from labkit.micro.fabric import statistics as fabric
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.snapshot import love_stress
from labkit.sff.budget import error_budget
from labkit.sff.family import stress

WHOLE_RUN = ("statistics", "love_stress", "sff_stress", "size_groups", "strong_networks", "contact_changes")


def bench_statistics(file: str | os.PathLike, rounds: int = 15) -> pandas.DataFrame:
    """Tabulate the cost of the statistics of a run file.

    The pandas.DataFrame has the milliseconds of each computation for the last snapshot (median of `rounds`), and the
    milliseconds and peak memory (MB) of each computation over the whole run, which is opened again for each.
    """
    run = labkit.open_run(file)
    snapshot = run.lab.snapshot(-1)
    group = groups_by_diameter(snapshot, diameter_edges(snapshot, 5))
    computations: dict[str, Callable[[], object]] = {
        "Z, A, Lambda, F, F^t": lambda: fabric(snapshot),
        "Love's stress": lambda: love_stress(snapshot),
        "five size groups": lambda: group_stresses(snapshot, group, 5),
        "C0": lambda: stress("c0", snapshot),
        "fourth order": lambda: stress("fourth", snapshot),
        "error budget": lambda: error_budget(snapshot),
        "reading the snapshot": lambda: run.lab.snapshot(-1),
    }
    size = f"one snapshot of {len(snapshot.contacts)} contacts"
    rows: list[dict[str, str | float]] = [
        {"what": f"{name}, {size}", "milliseconds": 1e3 * _median(compute, rounds)}
        for name, compute in computations.items()
    ]
    contact_size = sum(run[name].nbytes for name, variable in run.variables.items() if "contact" in variable.dims) / 1e6
    for name in WHOLE_RUN:
        seconds, peak = _whole(file, name)
        rows.append(
            {
                "what": f"{name}, {run.sizes['snapshot']} snapshots",
                "milliseconds": 1e3 * seconds,
                "peak_MB": peak,
                "all_contacts_MB": contact_size,
            }
        )
    return pandas.DataFrame(rows)


def _median(compute: Callable[[], object], rounds: int) -> float:
    """Return the median time of a computation, s."""
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        compute()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def _whole(file: str | os.PathLike, name: str) -> tuple[float, float]:
    """Return the seconds of a method of the accessor and, from a second pass, the peak MB of Python and numpy."""
    begin = time.perf_counter()
    getattr(labkit.open_run(file).lab, name)()
    seconds = time.perf_counter() - begin
    tracemalloc.start()
    try:
        getattr(labkit.open_run(file).lab, name)()
        return seconds, tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
