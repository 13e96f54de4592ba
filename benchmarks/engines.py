"""Speed of engines on one specimen, measured alternately.

Compare the ratios within one benchmark, not the times of different benchmarks.
"""

from __future__ import annotations

import functools
import os
import shutil
import statistics
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks import lammps as bench_lammps
from benchmarks.rounds import alternate, ratio
from benchmarks.speed import read_speeds, speed
from labkit.engines.base import Progress
from labkit.engines.yade import run_script, yade_program
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.paths.rates import on_grains
from labkit.paths.standard import ConstantVolume
from labkit.servo.correction import STANDARD
from labkit.servo.plan import prescribed_gradient

STOCK = Path(__file__).parent / "in_yade" / "stock.py"  # a plain YADE script

Variant = Callable[[str, int], dict[str, float]]


def stock_speed(file: str | os.PathLike[str], steps: int) -> dict[str, float]:
    """Measure a plain YADE script with the grains of a state file. Raises PhysicsError if it fails."""
    state = read_state(file)
    with tempfile.TemporaryDirectory() as folder:
        grains = Path(folder) / "grains.npz"
        np.savez(grains, radius=state.radius, position=state.position, cell=state.cell, time_step=state.time_step)
        return read_speeds(run_script(STOCK, [str(grains), str(steps)]))


def variants(scene: Scene) -> dict[str, Variant]:
    """Map names to functions (specimen file, steps) -> {quantity: value}, in the order of measurement.

    Contains the engines that are installed on this computer and support the contact law of the scene.
    """
    result: dict[str, Variant] = {}
    if yade_program() and scene.contact_law.yade(scene) is not None:
        if scene.law == "rolling_resistance":
            result["stock YADE script, 1 thread"] = stock_speed
        result["labkit on YADE, 1 thread"] = lambda file, steps: speed("yade", file, steps, 1)
        result["labkit on YADE, 2 threads"] = lambda file, steps: speed("yade", file, steps, 2)
    lammps = shutil.which("lmp")
    if lammps and scene.law in HOOKEAN:
        result["LAMMPS, 1 process"] = lambda file, steps: _in_lammps(lammps, file, steps)
    result["fused, 1 thread"] = lambda file, steps: speed("fused", file, FASTER * steps, 1)
    result["fused, 2 threads"] = lambda file, steps: speed("fused", file, FASTER * steps, 2)
    return result


HOOKEAN = ("rolling_resistance", "spring_dashpot", "springs_in_series")  # LAMMPS runs them with linear springs
FASTER = 10  # factor on the number of steps of the fused engine, so that its measurements last long enough


def bench(specimen: str, steps: int, rounds: int, progress: Progress) -> dict[str, list[dict[str, float]]]:
    """Run every variant `rounds` times, alternately; return variant -> list of {quantity: value}."""
    measured = variants(read_state(specimen).scene)
    file = os.path.abspath(specimen)
    runs = {name: functools.partial(run, file, steps) for name, run in measured.items()}
    return alternate(runs, rounds, progress)


def _in_lammps(program: str, specimen: str, steps: int) -> dict[str, float]:
    state = read_state(specimen)
    rates = prescribed_gradient(on_grains(ConstantVolume(), state.scene), state.time_step).diagonal()
    return {"steps_per_second": bench_lammps.steps_per_second(program, state, rates, steps)}


def table(results: Mapping[str, Sequence[Mapping[str, float]]], grains: int, time_step: float, rate: float) -> str:
    """Tabulate medians, ratios to the first variant (median and range of the rounds), cost of records and servo.

    `results` is the result of `bench`; `time_step` is in s, and `rate`, the axial strain rate, in 1/s.
    """
    base = [turn["steps_per_second"] for turn in next(iter(results.values()))]
    between = ConstantVolume.record_strain / (rate * time_step)
    heading = ("", "steps/s", "grain-steps/s", "ratio", "range", "records, %", "servo, %")
    lines = ["{:<30} {:>9} {:>14} {:>7} {:>13} {:>11} {:>9}".format(*heading)]
    for name, turns in results.items():
        speed = [turn["steps_per_second"] for turn in turns]
        record = [turn["steps_per_record"] / between for turn in turns if "steps_per_record" in turn]
        sums = [turn["steps_per_stress"] / STANDARD.interval for turn in turns if "steps_per_stress" in turn]
        median = statistics.median(speed)
        row = f"{name:<30} {median:9.1f} {median * grains:14.3g} {ratio(speed, base)}"
        if record:
            row += f" {100 * statistics.median(record):11.2f} {100 * statistics.median(sums):9.2f}"
        lines.append(row)
    return "\n".join(lines)
