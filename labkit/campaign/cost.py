"""What a campaign takes: grain-steps, time, memory and disk, from speeds that were measured on this computer.

An engine takes a + b N seconds for a step of N grains; a and b come from two specimens. What a record costs and what
the servo costs are measured in steps. How many steps a specimen takes was counted: they depend on no computer.
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
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from labkit.campaign.items import Campaign, Consolidated, Item, Run, schedule_of
from labkit.campaign.plan import Job, Plan
from labkit.dem.engine import Progress
from labkit.engines.speed import speed
from labkit.errors import PhysicsError
from labkit.io.files import write_text
from labkit.io.provenance import machine

SIZES = (150, 1000)  # grains of the specimens that speeds are measured on
STEPS = {"fused": 3000}
OTHER_STEPS = 500  # of any other engine
SPECIMEN_STEPS, CONSOLIDATION_STEPS = 10_000, 3_000  # about: 6,000 to 12,000 and 500 to 3,500 were counted
PRODUCT_SECONDS = 6.0  # statistics and figures of a run, about: half of it Python's start
MEMORY = {"yade": (350, 0.02)}  # MB of a process, and of each grain
OTHER_MEMORY = (450, 0.02)
CONTACTS_PER_GRAIN = 2.8
RECORD_BYTES = 60 * 8
SNAPSHOT_BYTES = 3 * 8 + CONTACTS_PER_GRAIN * 120  # a grain
STATE_BYTES = 13 * 8 + CONTACTS_PER_GRAIN * 68


@dataclasses.dataclass(frozen=True)
class Speed:
    """Of one engine on one thread: seconds to start, of a step and of a step of each grain; steps that a record and
    the sum of stresses for the servo are worth.
    """

    start: float
    step: float
    grain_step: float
    record_steps: float
    stress_steps: float

    def seconds(self, steps: float, grains: float) -> float:
        """Of so many steps of so many grains."""
        return steps * (self.step + self.grain_step * grains)


# Measured on two cores of a Xeon of 2.8 GHz; for where nothing was measured, on a cluster for example.
TYPICAL = {
    "fused": Speed(3.0, 1.2e-5, 4.3e-8, 45.0, 0.35),
    "yade": Speed(2.0, 0.0, 9.9e-7, 25.0, 0.4),
}


def typical_speeds(engines: Iterable[str]) -> dict[str, Speed]:
    """engine -> Speed where nothing was measured; an unknown engine counts as the slowest that is known."""
    return {engine: TYPICAL.get(engine, TYPICAL["yade"]) for engine in engines}


@dataclasses.dataclass(frozen=True)
class Cost:
    """Of one job: grain-steps, seconds on one thread, MB of memory, bytes on the disk, about."""

    grain_steps: float
    seconds: float
    memory: float
    disk: float


def cost_of(job: Job, campaign: Campaign, speeds: Mapping[str, Speed]) -> Cost:
    """The Cost of a job of a Plan. `speeds`: engine -> Speed. Paths that end at a stress cost at most this."""
    item, engine = job.item, speeds[job.item.engine]
    origin = campaign.origin(_made_of(item))
    grains = origin.expected_grains
    base, each = MEMORY.get(item.engine, OTHER_MEMORY)
    disk = STATE_BYTES * grains
    if isinstance(item, Run):
        schedule = schedule_of(item, origin)
        steps = schedule.steps
        records = steps / schedule.steps_per_record
        held = engine.stress_steps / item.options.servo.interval if item.loading().control() else 0.0
        worth = steps * (1.0 + held) + records * engine.record_steps
        disk += records * RECORD_BYTES + (item.options.snapshots + 1) * grains * SNAPSHOT_BYTES
    else:
        steps = worth = SPECIMEN_STEPS if job.kind == "specimen" else CONSOLIDATION_STEPS
    seconds = engine.start + engine.seconds(worth, grains) / item.threads
    return Cost(steps * grains, seconds, base + each * grains, disk)


def _made_of(item: Item) -> str:
    """The name of the specimen that a job begins with, or that it makes."""
    if isinstance(item, Run):
        return item.specimen
    return item.source if isinstance(item, Consolidated) else item.name


def expected_seconds(plan: Plan, costs: Mapping[Job, Cost], cores: int) -> float:
    """How long the plan takes on these cores: each job begins as soon as what it needs is there and a core is free."""
    free = [0.0] * cores
    done: dict[str, float] = {}
    for job in (*plan.specimens, *plan.consolidations, *sorted(plan.runs, key=lambda run: -costs[run].seconds)):
        begin = max(heapq.heappop(free), done.get(job.source or "", 0.0))
        done[job.output] = begin + costs[job].seconds
        heapq.heappush(free, done[job.output])
    return max(free) + len(plan.runs) * PRODUCT_SECONDS / cores


def summary(plan: Plan, speeds: Mapping[str, Speed], cores: int) -> str:
    """The table that `--dry-run` prints, as text."""
    costs = {job: cost_of(job, plan.campaign, speeds) for job in plan.jobs}
    lines = [f"{'kind':<14} {'name':<40} {'engine':<7} {'grain-steps':>11} {'time':>9} {'disk':>9}"]
    for job in plan.jobs:
        cost = costs[job]
        numbers = f"{cost.grain_steps:>11.2e} {time_text(cost.seconds):>9} {size_text(cost.disk):>9}"
        lines.append(f"{job.kind:<14} {job.name:<40} {job.item.engine:<7} {numbers}")
    total = sum(cost.seconds for cost in costs.values()) + len(plan.runs) * PRODUCT_SECONDS
    lines += [
        f"{len(plan.specimens)} specimens, {len(plan.consolidations)} consolidations, {len(plan.runs)} runs: "
        f"{sum(cost.grain_steps for cost in costs.values()):.3g} grain-steps",
        f"about {time_text(expected_seconds(plan, costs, cores))} on {cores} cores, {time_text(total)} on one "
        "(speeds measured on this computer); tests that end at a stress take less",
        f"about {size_text(sum(cost.disk for cost in costs.values()))} on the disk",
    ]
    return "\n".join(lines)


def time_text(seconds: float) -> str:
    """Hours, minutes and seconds."""
    seconds = round(seconds)
    return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def size_text(size: float) -> str:
    """Bytes with a unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"


def cache_file() -> Path:
    """Where the speeds of this computer are kept: $XDG_CACHE_HOME/labkit, else ~/.cache/labkit."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "labkit" / "speed.json"


def known_speeds(engines: Iterable[str]) -> dict[str, Speed] | None:
    """engine -> Speed as measured on this computer before, or None when one is not."""
    try:
        known = json.loads(cache_file().read_text())[computer()]
        return {engine: Speed(**known[engine]) for engine in engines}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def computer() -> str:
    """What tells this computer from others."""
    here = machine()
    return f"{here['name']}, {here['processor']}, {here['cores']} cores"


def measure_speeds(engines: Sequence[str], progress: Progress) -> dict[str, Speed]:
    """engine -> Speed, measured now and kept. Raises PhysicsError when an engine does not run."""
    with tempfile.TemporaryDirectory(prefix="labkit-") as folder:
        progress(0.0, "specimens to measure on")
        files = [_specimen(grains, Path(folder)) for grains in SIZES]
        found = {}
        for number, engine in enumerate(engines):
            progress(0.5 + 0.5 * number / len(engines), f"speed of {engine}")
            found[engine] = _speed_of(engine, files)
        progress(1.0, "speeds measured")
    _keep(found)
    return found


def _specimen(grains: int, folder: Path) -> Path:
    """A state file, made in a process of its own."""
    file = folder / f"n{grains}.state.nc"
    done = subprocess.run([sys.executable, "-c", MAKE, str(grains), str(file)], capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["no output"]
        raise PhysicsError(f"speeds cannot be measured: {said[-1]}")
    return file


MAKE = """
import sys
from labkit.runs.laboratory import make_specimen
from labkit.dem.specimen import Recipe
make_specimen(Recipe(void_ratio=0.67, grains=int(sys.argv[1])), file=sys.argv[2], progress=False)
"""


def _speed_of(engine: str, files: Sequence[Path]) -> Speed:
    steps = STEPS.get(engine, OTHER_STEPS)
    runs = [_timed(engine, file, steps) for file in files]
    small, large = (1.0 / values["steps_per_second"] for _, values in runs)
    grain_step = max((large - small) / (SIZES[1] - SIZES[0]), 0.1 * large / SIZES[1])
    step = max(small - grain_step * SIZES[0], 0.0)
    start = max(runs[0][0] - 2.0 * steps * small, 0.5)  # a fifth warms up; records and stresses are the rest
    last = runs[1][1]
    return Speed(start, step, grain_step, last["steps_per_record"], last["steps_per_stress"])


def _timed(engine: str, file: Path, steps: int) -> tuple[float, dict[str, float]]:
    """(seconds, {quantity: value}) of a measurement in a process of its own."""
    begin = time.monotonic()
    found = speed(engine, file, steps)
    return time.monotonic() - begin, found


def _keep(found: Mapping[str, Speed]) -> None:
    file = cache_file()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        known = json.loads(file.read_text()) if file.exists() else {}
        here = {**known.get(computer(), {}), **{name: dataclasses.asdict(one) for name, one in found.items()}}
        write_text(file, json.dumps({**known, computer(): here}, indent=1))
    except (OSError, ValueError):
        return  # measured again next time
