"""Speed on one scene, measured in turn: ratios of one run are compared, not times of different ones."""

from __future__ import annotations

import os
import statistics
import subprocess

from labkit import servo
from labkit.engines.yade_process import find_script, find_yade, yade_environment
from labkit.errors import PhysicsError
from labkit.paths import ConstantVolume

VARIANTS = {
    "stock script, 1 thread": ("stock.py", 1),
    "labkit on YADE, 1 thread": ("speed.py", 1),
    "labkit on YADE, 2 threads": ("speed.py", 2),
}


def bench(specimen, steps, rounds, progress):
    """Runs every variant `rounds` times in turn; variant -> list of {quantity: value}."""
    found = {name: [] for name in VARIANTS}
    for turn in range(rounds):
        for number, (name, (script, threads)) in enumerate(VARIANTS.items()):
            progress((turn * len(VARIANTS) + number) / (rounds * len(VARIANTS)), name)
            found[name].append(_run(script, threads, specimen, steps))
    progress(1.0, "done")
    return found


def _run(script, threads, specimen, steps):
    command = [find_yade(), "-n", "-x", f"-j{threads}", str(find_script(script)), os.path.abspath(specimen), str(steps)]
    done = subprocess.run(command, env=yade_environment(), capture_output=True, text=True)
    words = [line.split() for line in done.stdout.splitlines() if line.startswith("steps_per_")]
    if done.returncode or not words:
        raise PhysicsError(f"{script} ended with exit status {done.returncode}: {done.stderr.strip()[-300:]}")
    return {name: float(value) for name, value in words}


def table(found, grains, time_step, rate):
    """Medians, ratios to the first variant (median and range over the rounds), cost of records and of the servo."""
    base = [turn["steps_per_second"] for turn in next(iter(found.values()))]
    between = ConstantVolume.record_strain / (rate * time_step)
    heading = ("", "steps/s", "grain-steps/s", "ratio", "range", "records, %", "servo, %")
    lines = ["{:<30} {:>9} {:>14} {:>7} {:>13} {:>11} {:>9}".format(*heading)]
    for name, turns in found.items():
        speed = [turn["steps_per_second"] for turn in turns]
        ratio = [a / b for a, b in zip(speed, base)]
        record = [turn["steps_per_record"] / between for turn in turns if "steps_per_record" in turn]
        sums = [turn["steps_per_stress"] / servo.INTERVAL for turn in turns if "steps_per_stress" in turn]
        median = statistics.median(speed)
        row = f"{name:<30} {median:9.1f} {median * grains:14.3g} {statistics.median(ratio):7.2f} "
        row += f"{min(ratio):6.2f}-{max(ratio):<6.2f}"
        if record:
            row += f" {100 * statistics.median(record):11.2f} {100 * statistics.median(sums):9.2f}"
        lines.append(row)
    return "\n".join(lines)
