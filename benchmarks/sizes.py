"""Time per grain and step and memory of specimens of about 1,000 to 1,000,000 grains, beside LAMMPS."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Sequence

import pandas

from benchmarks import lammps
from benchmarks.engines import HOOKEAN
from benchmarks.kernel import copies, seconds_per_step
from labkit.engines.base import Progress
from labkit.engines.fused import FusedEngine
from labkit.grains.state import State
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.servo.correction import prescribed_gradient

SIZES = (1_000, 14_000, 110_000, 1_000_000)  # approximate numbers of grains, reached by copying the specimen
TUNING = lammps.Tuning(0.1, "on", 200)  # of LAMMPS: the fastest with 14,331 grains, see results/bench
ROUNDS = 3


def sizes(state: State, steps: int, progress: Progress, grains: Sequence[int] = SIZES) -> pandas.DataFrame:
    """Nanoseconds per grain and step on one thread, without records and searches of neighbours, a row per size.

    steps: with 10,000 grains; there are fewer with more grains, but at least 20. Columns: grains; double, mixed (the
    fused engine, CPU time), lammps (its loop; NaN if it is not installed or lacks the contact law): medians of
    alternating rounds; memory: peak so far of this process, bytes per grain.
    """
    program = shutil.which("lmp") if state.scene.law in HOOKEAN else None
    rows = []
    for number, wanted in enumerate(grains):
        progress(number / len(grains), f"{wanted} grains")
        ratio = max(1.0, (wanted / state.number_of_grains) ** (1 / 3))
        many = copies(state, [int(ratio) + (ratio % 1 > share) for share in (0.75, 0.5, 0.25)])
        count = max(20, round(steps * 10_000 / many.number_of_grains))
        rows.append(_measured(many, count, program))
    progress(1.0, "done")
    return pandas.DataFrame(rows)


def _measured(state: State, steps: int, program: str | None) -> dict[str, float]:
    """A row of the table."""
    n = state.number_of_grains
    rates = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step).diagonal()
    engines = {precision: FusedEngine(state, precision=precision) for precision in ("double", "mixed")}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    for engine in engines.values():
        seconds_per_step(engine, state, steps // 5)
    rounds = []
    for _ in range(ROUNDS):
        row = {name: seconds_per_step(engine, state, steps) for name, engine in engines.items()}
        if program:
            row["lammps"] = 1.0 / lammps.steps_per_second(program, state, rates, steps, TUNING)
        rounds.append(row)
    medians = 1e9 / n * pandas.DataFrame(rounds, columns=["double", "mixed", "lammps"], dtype=float).median()
    return {"grains": n, **medians.to_dict(), "memory": memory / n}
