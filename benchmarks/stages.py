"""An account of a time step: nanoseconds per grain by stage, beside the limits of this core.

    python -m benchmarks.stages s.state.nc large.state.nc --rounds 7

One thread, shear at constant volume. The host is compiled a second time, with a clock around each stage. The limit of a
stage is the larger of the times for its operations and for its bytes, at the rates that this core reaches in the same
run; bytes count once per step what a step must read or write, whether it lies in a cache or not.
"""

from __future__ import annotations

import argparse
import ctypes
import functools
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from benchmarks.kernel import FLOPS, TimedEngine, bandwidth_of, peak_flops, seconds_per_step, traffic
from labkit.engines.host import build
from labkit.engines.kernel import host
from labkit.grains.state import State
from labkit.grains.state_file import read_state

STAGES = ("read", "law", "add", "move", "images")
MOTION_FLOPS = 120


class Work(NamedTuple):
    """Operations and bytes of a stage in one step."""

    flops: float
    bytes: float


def work_of(engine: TimedEngine, law: str) -> dict[str, Work]:
    """Return the Work of each stage."""
    packing = engine.packing
    arrays, pairs, grains = packing.arrays, len(packing.slot), len(packing.order)
    sites, images = len(arrays.places), len(arrays.owner)
    contact_bytes, _, grain_bytes = traffic(arrays)
    record = arrays.places[0].nbytes + arrays.motions[0].nbytes
    force, indices = arrays.forces[0].nbytes, arrays.pairs[:, 0].nbytes
    return {
        "read": Work(0.0, pairs * indices + sites * record),
        "law": Work(pairs * FLOPS[law], pairs * (contact_bytes - indices)),
        "add": Work(0.0, 2.0 * sites * force),
        "move": Work(grains * MOTION_FLOPS, grains * (grain_bytes + record + 2 * force)),
        "images": Work(0.0, images * (2 * record + 4 * force)),
    }


def measure(state: State, precision: str, steps: int, rounds: int) -> tuple[list[dict[str, float]], TimedEngine]:
    """Return seconds per step by stage of each round, with the neighbour searches and the whole, and the engine."""
    seconds = (ctypes.c_double * len(STAGES)).in_dll(host.library(), "stage_seconds")
    engine = TimedEngine(state, precision)
    found = []
    for _ in range(rounds + 1):  # the first round warms up
        engine.load(state)
        engine.searches.clear()
        seconds[:] = [0.0] * len(STAGES)
        begin = time.process_time()
        seconds_per_step(engine, state, steps)
        whole = (time.process_time() - begin) / steps
        own = {name: spent / steps for name, spent in zip(STAGES, seconds, strict=True)}
        found.append(own | {"search": sum(engine.searches) / steps, "whole step": whole})
    return found[1:], engine


def report(state: State, precision: str, steps: int, rounds: int) -> list[str]:
    """Return the lines of a table."""
    found, engine = measure(state, precision, steps, rounds)
    grains, work = state.number_of_grains, work_of(engine, state.scene.law)
    bandwidth, peak = bandwidth_of(3_000_000), peak_flops() * (2 if precision == "mixed" else 1)
    pairs, images = len(engine.packing.slot), len(engine.packing.arrays.owner)
    lines = [
        f"{grains:,} grains, {precision}: {pairs / grains:.2f} pairs and {images / grains:.2f} images per grain; this "
        f"core {bandwidth / 1e9:.0f} GB/s, {peak / 1e9:.0f} GFLOP/s",
        f"{'ns per grain and step':24}{'measured':>10}{'operations':>12}{'bytes':>8}{'limit/measured':>16}",
    ]
    for name in found[0]:
        spent = 1e9 * statistics.median(turn[name] for turn in found) / grains
        line = f"{name:24}{spent:10.2f}"
        if name in work:
            flops, moved = (1e9 * w / rate / grains for w, rate in zip(work[name], (peak, bandwidth), strict=True))
            line += f"{flops:12.2f}{moved:8.2f}{max(flops, moved) / spent:16.2f}"
        lines.append(line)
    return lines


def with_clocks(folder: Path) -> Callable[[], ctypes.CDLL]:
    """Return a function that loads a host with a clock around each stage."""
    file = build.build_host(folder, ["-DTIME_STAGES"])
    return functools.cache(lambda: ctypes.CDLL(str(file)))


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("states", nargs="+", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--grain-steps", type=float, default=1e7, help="grains times time steps in a round")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        host.library = with_clocks(Path(folder))
        for state in map(read_state, options.states):
            steps = max(10, int(options.grain_steps / state.number_of_grains))
            for precision in ("double", "mixed"):
                print("\n".join(report(state, precision, steps, options.rounds)), flush=True)


if __name__ == "__main__":
    main()
