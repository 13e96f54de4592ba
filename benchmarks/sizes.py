"""Memory, and time per grain and step, of specimens of about 1,000 to 1,000,000 grains, compared with LAMMPS."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Sequence

import pandas

from benchmarks import lammps
from benchmarks.engines import HOOKEAN
from benchmarks.kernel import bandwidth_of, bytes_per_step, copies, seconds_per_step
from labkit.engines.base import Progress
from labkit.engines.fused import FusedEngine
from labkit.grains.state import State
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.servo.plan import prescribed_gradient

SIZES = (1_000, 14_000, 110_000, 1_000_000)  # approximate numbers of grains, reached by copying the specimen
TUNING = lammps.Tuning(0.1, "on", 200)  # the fastest tuning of LAMMPS with 14,331 grains, see results/bench
ROUNDS = 5


def sizes(state: State, steps: int, progress: Progress, grains: Sequence[int] = SIZES) -> pandas.DataFrame:
    """Measure nanoseconds per grain and step on one thread, without records and neighbour searches; one row per size.

    The columns are grains, medians of alternating rounds, and memory, the peak of this process so far, bytes per grain.
    The medians are double and mixed (CPU time of the fused engine), floor_double and floor_mixed (the bytes that a step
    moves over the bandwidth of one core on arrays of this size), and lammps (its loop; NaN if LAMMPS is not installed
    or lacks the contact law).

    Args:
        state: The specimen.
        steps: Number of steps with 10,000 grains; larger specimens take fewer, but at least 20.
        progress: Called with the progress.
        grains: Approximate numbers of grains.
    """
    program = shutil.which("lmp") if state.scene.law in HOOKEAN else None
    rows = []
    for number, wanted in enumerate(grains):
        progress(number / len(grains), f"{wanted} grains")
        ratio = max(1.0, (wanted / state.number_of_grains) ** (1 / 3))
        many = copies(state, [int(ratio) + (ratio % 1 > share) for share in (0.75, 0.5, 0.25)])
        count = max(20, round(steps * 10_000 / many.number_of_grains))
        rows.append(_measure(many, count, program))
    progress(1.0, "done")
    return pandas.DataFrame(rows)


def _measure(state: State, steps: int, program: str | None) -> dict[str, float]:
    """Measure one row of the table."""
    n = state.number_of_grains
    rates = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step).diagonal()
    engines = {precision: FusedEngine(state, precision=precision) for precision in ("double", "mixed")}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    for engine in engines.values():
        seconds_per_step(engine, state, steps // 5)
    rounds = []
    for _ in range(ROUNDS):
        row = {name: seconds_per_step(engine, state, steps) for name, engine in engines.items()}
        for name, engine in engines.items():
            moved = bytes_per_step(engine.packing)
            row[f"floor_{name}"] = moved / bandwidth_of(int(moved))
        if program:
            row["lammps"] = 1.0 / lammps.steps_per_second(program, state, rates, steps, TUNING)
        rounds.append(row)
    medians = (
        1e9
        / n
        * pandas.DataFrame(
            rounds, columns=["double", "mixed", "floor_double", "floor_mixed", "lammps"], dtype=float
        ).median()
    )
    return {"grains": n, **medians.to_dict(), "memory": memory / n}
