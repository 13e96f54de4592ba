"""Speed of whole `labkit run cv` commands, with records, saves and the start of Python, and of other programs."""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas

from benchmarks import lammps
from benchmarks.engines import HOOKEAN, stock_speed
from benchmarks.kernel import bandwidth_of, peak_flops
from benchmarks.rounds import alternate
from labkit.engines.base import Progress
from labkit.engines.yade import yade_program
from labkit.errors import PhysicsError
from labkit.grains.state_file import read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.results.run import Run
from labkit.servo.plan import prescribed_gradient

Measure = Callable[[], tuple[float, float]]  # steps, seconds
TRIALS = 3  # measurements of each setting of LAMMPS
YADE_STRAIN = 1e-3  # axial strain of the whole command on YADE: one record

COMMANDS = {
    "labkit run cv, fused": ("--engine", "fused"),
    "labkit run cv, fused, mixed precision": ("--engine", "fused", "--precision", "mixed"),
}


def commands(specimen: str, strain: float, steps: int, rounds: int, progress: Progress) -> pandas.DataFrame:
    """Measure whole commands and the loops of other programs alternately, all on one thread.

    The commands write the standard records and saves, and are timed from the start of Python to its end. Returns one
    row for each variant and round: `variant`, `round`, `steps`, `seconds`, `steps_per_second`.

    Args:
        specimen: State file.
        strain: Axial strain of each timed command (0.1 % on YADE).
        steps: Steps of the other programs' loops.
        rounds: Number of rounds.
        progress: Called with the progress.
    """
    state = read_state(specimen)
    file = str(Path(specimen).resolve())
    rates = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step).diagonal()
    variants: dict[str, Measure] = {}
    if yade_program() and state.scene.law == "rolling_resistance":
        variants["stock YADE script, loop"] = lambda: _loop(stock_speed(file, steps)["steps_per_second"], steps)
        variants["labkit run cv, yade"] = lambda: _whole(file, YADE_STRAIN, ("--engine", "yade"))
    program = shutil.which("lmp")
    if program and state.scene.law in HOOKEAN:
        progress(0.0, "settings of LAMMPS")
        tuning = lammps.fastest(program, state, rates, steps, TRIALS)
        name = f"LAMMPS, loop, {tuning}"
        variants[name] = lambda: _loop(lammps.steps_per_second(program, state, rates, 5 * steps, tuning), 5 * steps)
    for name, options in COMMANDS.items():
        variants[name] = lambda options=options: _whole(file, strain, options)  # type: ignore[misc]
    results = alternate(variants, rounds, progress)
    rows = [
        (name, turn + 1, *results[name][turn], results[name][turn][0] / results[name][turn][1])
        for turn in range(rounds)
        for name in results
    ]
    return pandas.DataFrame(rows, columns=["variant", "round", "steps", "seconds", "steps_per_second"])


def _loop(speed: float, steps: int) -> tuple[float, float]:
    return steps, steps / speed


def _whole(specimen: str, strain: float, options: tuple[str, ...]) -> tuple[float, float]:
    """Measure steps and seconds of a whole command."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "r.run.nc"
        command = [sys.executable, "-P", "-m", "labkit.cli", "run", "cv", specimen, "--strain", str(strain), *options]
        begin = time.perf_counter()
        done = subprocess.run([*command, "-o", str(output)], capture_output=True, text=True)
        seconds = time.perf_counter() - begin
        if done.returncode:
            raise PhysicsError(f"labkit run ended with exit status {done.returncode}: {done.stderr.strip()[-300:]}")
        run = Run.open(output)
        with run.data:
            return run.steps, seconds


def summary(speeds: pandas.DataFrame, grains: int) -> str:
    """Tabulate medians and ranges of the speeds, ratios to the other programs, and the limits of a core."""
    each = {name: group.set_index("round")["steps_per_second"] for name, group in speeds.groupby("variant", sort=False)}
    others = [name for name in each if "loop" in name]
    lines = [
        f"{'':<58} {'steps/s':>9} {'range':>15}"
        + "".join(f" {'to ' + one.split()[0].strip(','):>12}" for one in others)
    ]
    for name, values in each.items():
        line = f"{name:<58} {values.median():9.1f} {values.min():7.1f}-{values.max():<7.1f}"
        lines.append(line + "".join(f" {statistics.median(values / each[one]):12.2f}" for one in others))
    lines += [
        f"{grains} grains, {speeds['round'].max()} rounds; ratios are medians of those of each round",
        f"this core: {bandwidth_of(3_000_000) / 1e9:.0f} GB/s on arrays of 3 MB, {peak_flops() / 1e9:.0f} GFLOP/s",
    ]
    return "\n".join(lines)
