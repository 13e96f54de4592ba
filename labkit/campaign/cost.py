"""What a campaign takes: grain-steps, time, memory and disk, from speeds that were measured on this machine.

An engine takes a + b N seconds for a step of N grains; a and b come from two specimens. What a record costs and what
the servo costs are measured in steps. How many steps a specimen takes was counted: they depend on no machine.
"""

from __future__ import annotations

import dataclasses
import heapq
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from labkit.bench import engines as bench
from labkit.campaign.file import schedule_of
from labkit.errors import PhysicsError
from labkit.io.files import write_text
from labkit.io.provenance import machine
from labkit.dem.servo import STANDARD

SIZES = (150, 1000)  # grains of the specimens that speeds are measured on
STEPS = {"fused": 3000, "yade": 500}
SPECIMEN_STEPS, CONSOLIDATION_STEPS = 10_000, 3_000  # about: 6,000 to 12,000 and 500 to 3,500 were counted
PRODUCT_SECONDS = 6.0  # statistics and figures of a run, about: half of it Python's start
MEMORY = {"fused": (450, 0.02), "yade": (350, 0.02)}  # MB of a process, and of each grain
CONTACTS_PER_GRAIN = 2.8
RECORD_BYTES = 60 * 8
SNAPSHOT_BYTES = 3 * 8 + CONTACTS_PER_GRAIN * 120  # a grain
STATE_BYTES = 13 * 8 + CONTACTS_PER_GRAIN * 68


@dataclasses.dataclass(frozen=True)
class Speed:
    """Of one engine on one thread: seconds to start, of a step and of a step of each grain; steps that a record and
    the sum of stresses for the servo are worth."""

    start: float
    step: float
    grain_step: float
    record_steps: float
    stress_steps: float

    def seconds(self, steps, grains):
        return steps * (self.step + self.grain_step * grains)


# Measured on two cores of a Xeon of 2.8 GHz; stands where nothing was measured, on a cluster for example.
TYPICAL = {
    "fused": Speed(3.0, 1.2e-5, 4.3e-8, 45.0, 0.35),
    "yade": Speed(2.0, 0.0, 9.9e-7, 25.0, 0.4),
}


@dataclasses.dataclass(frozen=True)
class Cost:
    """Of one job: grain-steps, seconds on one thread, MB of memory, bytes on the disk, about."""

    grain_steps: float
    seconds: float
    memory: float
    disk: float


def cost_of(job, campaign, speeds):
    """The Cost of a job of a Plan. `speeds`: engine -> Speed. Paths that end at a stress cost at most this."""
    item, speed = job.item, speeds[job.item.engine]
    origin = campaign.origin(getattr(item, {"run": "specimen", "consolidation": "source"}.get(job.kind, "name")))
    grains = origin.expected_grains
    base, each = MEMORY[item.engine]
    disk = STATE_BYTES * grains
    if job.kind == "run":
        schedule = schedule_of(item, origin)
        steps = schedule.steps
        records = steps / schedule.steps_per_record
        held = speed.stress_steps / STANDARD.interval if item.loading().control() else 0.0
        worth = steps * (1.0 + held) + records * speed.record_steps
        disk += records * RECORD_BYTES + (item.snapshots + 1) * grains * SNAPSHOT_BYTES
    else:
        steps = worth = SPECIMEN_STEPS if job.kind == "specimen" else CONSOLIDATION_STEPS
    return Cost(steps * grains, speed.start + speed.seconds(worth, grains) / item.threads, base + each * grains, disk)


def expected_seconds(plan, costs, cores):
    """How long the plan takes on these cores: each job begins as soon as what it needs is there and a core is free."""
    free = [0.0] * cores
    done = {}
    for job in (*plan.specimens, *plan.consolidations, *sorted(plan.runs, key=lambda run: -costs[run].seconds)):
        begin = max(heapq.heappop(free), done.get(job.source, 0.0))
        done[job.output] = begin + costs[job].seconds
        heapq.heappush(free, done[job.output])
    return max(free) + len(plan.runs) * PRODUCT_SECONDS / cores


def summary(plan, speeds, cores, measured):
    """The table that `--dry-run` prints, as text."""
    costs = {job: cost_of(job, plan.campaign, speeds) for job in plan.jobs}
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    for job in plan.jobs:
        cost = costs[job]
        numbers = f"{cost.grain_steps:>11.2e} {time_words(cost.seconds):>9} {size_words(cost.disk):>9}"
        lines.append(f"{job.kind:<14} {job.name:<40} {job.item.engine:<7} {numbers}")
    total = sum(cost.seconds for cost in costs.values()) + len(plan.runs) * PRODUCT_SECONDS
    lines += [
        f"{len(plan.specimens)} specimens, {len(plan.consolidations)} consolidations, {len(plan.runs)} runs: "
        f"{sum(cost.grain_steps for cost in costs.values()):.3g} grain-steps",
        f"about {time_words(expected_seconds(plan, costs, cores))} on {cores} cores, {time_words(total)} on one "
        f"({'speeds measured on this machine' if measured else 'typical speeds, not measured here'}); tests that end "
        "at a stress take less",
        f"about {size_words(sum(cost.disk for cost in costs.values()))} on the disk",
    ]
    return "\n".join(lines)


def time_words(seconds):
    seconds = round(seconds)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def size_words(size):
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"


def cache_file():
    """Where the speeds of this machine are kept: $XDG_CACHE_HOME/labkit, else ~/.cache/labkit."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "labkit" / "speed.json"


def known_speeds(engines):
    """engine -> Speed as measured on this machine before, or None when one is not."""
    try:
        known = json.loads(cache_file().read_text())[machine_key()]
        return {engine: Speed(**known[engine]) for engine in engines}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def machine_key():
    here = machine()
    return f"{here['name']}, {here['processor']}, {here['cores']} cores"


def measure_speeds(engines, progress):
    """engine -> Speed, measured now and kept. Raises PhysicsError when an engine does not run."""
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        progress(0.0, "specimens to measure on")
        files = []
        for grains in SIZES:
            file = Path(folder) / f"n{grains}.state.nc"
            words = ["specimen", "--void-ratio=0.67", f"--grains={grains}", "--engine=fused", "-o", str(file)]
            done = subprocess.run([sys.executable, "-m", "labkit.cli", *words], capture_output=True, text=True)
            if done.returncode:
                said = done.stderr.strip().splitlines() or ["no output"]
                raise PhysicsError(f"speeds cannot be measured: {said[-1]}")
            files.append(file)
        found = {}
        for number, engine in enumerate(engines):
            progress(0.5 + 0.25 * number, f"speed of {engine}")
            found[engine] = _speed_of(engine, files)
        progress(1.0, "speeds measured")
    _keep(found)
    return found


def _speed_of(engine, files):
    runs = [_steps(engine, file) for file in files]
    small, large = (1.0 / values["steps_per_second"] for _, values in runs)
    grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
    step = max(small - grain_step * SIZES[0], 0.0)
    start = max(runs[0][0] - 2.0 * STEPS[engine] * small, 0.5)  # a fifth warms up; records and stresses are the rest
    last = runs[1][1]
    return Speed(start, step, grain_step, last["steps_per_record"], last["steps_per_stress"])


def _steps(engine, file):
    """(seconds, {quantity: value}) of labkit.bench.speed in a process of its own."""
    begin = time.monotonic()
    if engine == "yade":
        found = bench.in_yade("speed.py", 1, str(file), STEPS[engine])
    else:
        found = bench.in_fused(1, str(file), STEPS[engine])
    return time.monotonic() - begin, found


def _keep(found):
    file = cache_file()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        known = json.loads(file.read_text()) if file.exists() else {}
        here = {**known.get(machine_key(), {}), **{name: dataclasses.asdict(speed) for name, speed in found.items()}}
        write_text(file, json.dumps({**known, machine_key(): here}, indent=1))
    except (OSError, ValueError):
        return  # measured again next time
