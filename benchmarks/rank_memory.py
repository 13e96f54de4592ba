"""Memory of each rank per grain of its own: between two searches, and the most at loading, searching and recording.

    MALLOC_MMAP_THRESHOLD_=500000 python -m benchmarks.rank_memory s.state.nc --copies 3 3 3 --engine lammps --ranks 2

The variable lets the system have freed memory at once, so that the stages are measured apart.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

import labkit as lk
from benchmarks.kernel import copies
from benchmarks.rank_kills import ranks_of
from labkit.engines.base import Engine
from labkit.engines.device import Device
from labkit.engines.fused import FusedEngine
from labkit.engines.on_ranks import OnRanks
from labkit.paths.standard import ConstantVolume
from labkit.servo.plan import prescribed_gradient

RATE = 25.0  # 1/s
STAGES = ("at rest", "loading", "searching", "recording")


def is_rank(process: int) -> bool:
    """Return True for Python, False for the launcher and for `ps`, which has ended."""
    words = Path(f"/proc/{process}/cmdline")
    return words.exists() and "python" in words.read_text().split("\0")[0]


def memory(process: int, which: str) -> int:
    """Return VmRSS or VmHWM of a process, in kB."""
    found = re.search(rf"{which}:\s+(\d+)", Path(f"/proc/{process}/status").read_text())
    assert found
    return int(found[1])


def measure(file: str, times: list[int], device: Device, steps: int) -> tuple[int, list[list[int]]]:
    """Return the number of grains, and the memory (kB) of each rank in each of STAGES."""

    def make() -> tuple[int, float, Engine]:
        state = copies(lk.read_state(file), times)
        return state.number_of_grains, state.time_step, device(state)

    grains, time_step, engine = make()
    gradient = prescribed_gradient(ConstantVolume(RATE), time_step)
    ranks = [process for process in ranks_of(os.getpid()) if is_rank(process)]
    loading = [memory(process, "VmHWM") for process in ranks]

    def most(stage: Callable[[], object]) -> list[int]:
        for process in ranks:
            Path(f"/proc/{process}/clear_refs").write_text("5")  # VmHWM from now on
        stage()
        return [memory(process, "VmHWM") for process in ranks]

    def search() -> None:
        engine.advance(steps, gradient)
        if isinstance(engine, OnRanks):
            engine._repeat("_search_again")
        else:
            cast(FusedEngine, engine)._search_again()

    searching = most(search)
    rest = [memory(process, "VmRSS") for process in ranks]
    recording = most(engine.state)
    return grains, [list(row) for row in zip(rest, loading, searching, recording, strict=True)]


def main() -> None:
    """Measure a specimen and its copies, and print one line for each rank."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("specimen")
    parser.add_argument("--copies", nargs=3, type=int, default=[4, 4, 4])
    parser.add_argument("--engine", default="lammps")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--steps", type=int, default=4, help="time steps before the search")
    asked = parser.parse_args()
    device = Device(asked.engine, ranks=asked.ranks)
    one, few = measure(asked.specimen, [1, 1, 1], device, asked.steps)
    all_grains, rows = measure(asked.specimen, asked.copies, device, asked.steps)
    grains = (all_grains - one) / asked.ranks
    print(f"{asked.engine}, kB for each of {grains:.0f} grains of a rank: {', '.join(STAGES)}")
    for rank, (row, base) in enumerate(zip(rows, few, strict=True)):
        print(f"rank {rank}: " + ", ".join(f"{(a - b) / grains:.2f}" for a, b in zip(row, base, strict=True)))


if __name__ == "__main__":
    main()
