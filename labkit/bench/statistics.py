"""Speed and memory of the statistics of a run: per snapshot in memory, and over the whole file with reading."""

from __future__ import annotations

import os
import statistics
import time
import tracemalloc

import pandas

import labkit
from labkit.micro.fabric import statistics as fabric
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.stress import love_stress
from labkit.sff.budget import error_budget
from labkit.sff.family import stress

WHOLE_RUN = ("statistics", "love_stress", "sff_stress", "size_groups", "strong_networks", "contact_changes")


def bench_statistics(file: str | os.PathLike, rounds: int = 15) -> pandas.DataFrame:
    """A pandas.DataFrame: milliseconds of each computation for the last snapshot (median of `rounds`), and seconds and
    peak memory (MB) of each over the whole run, opened anew.
    """
    run = labkit.open_run(file)
    snapshot = run.lab.snapshot(-1)
    group = groups_by_diameter(snapshot, diameter_edges(snapshot, 5))
    of_one = {
        "Z, A, Lambda, F, F^t": lambda: fabric(snapshot),
        "Love's stress": lambda: love_stress(snapshot),
        "five size groups": lambda: group_stresses(snapshot, group, 5),
        "C0": lambda: stress("c0", snapshot),
        "fourth order": lambda: stress("fourth", snapshot),
        "error budget": lambda: error_budget(snapshot),
        "reading the snapshot": lambda: run.lab.snapshot(-1),
    }
    size = f"one snapshot of {len(snapshot.contacts)} contacts"
    rows = [{"what": f"{name}, {size}", "milliseconds": 1e3 * _median(of, rounds)} for name, of in of_one.items()]
    held = sum(run[name].nbytes for name, variable in run.variables.items() if "contact" in variable.dims) / 1e6
    for name in WHOLE_RUN:
        seconds, peak = _whole(file, name)
        rows.append(
            {
                "what": f"{name}, {run.sizes['snapshot']} snapshots",
                "milliseconds": 1e3 * seconds,
                "peak_MB": peak,
                "all_contacts_MB": held,
            }
        )
    return pandas.DataFrame(rows)


def _median(of, rounds):
    taken = []
    for _ in range(rounds):
        begin = time.perf_counter()
        of()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken)


def _whole(file, name):
    """(seconds, peak MB of Python's and numpy's memory) of a method of the accessor; the memory in a second pass."""
    begin = time.perf_counter()
    getattr(labkit.open_run(file).lab, name)()
    seconds = time.perf_counter() - begin
    tracemalloc.start()
    try:
        getattr(labkit.open_run(file).lab, name)()
        return seconds, tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()
