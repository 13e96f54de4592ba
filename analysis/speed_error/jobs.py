"""The runs of a study: each a process of its own, each kept in a folder, so that a study goes on where it was cut off.

Wall time is compared with a yardstick: steps of the baseline's first specimen, timed just before and after the run
in the same process. What else the computer does slows down both.
"""

from __future__ import annotations

import concurrent.futures
import json
import multiprocessing
import statistics
import time
from pathlib import Path

import numpy as np

import labkit as lk
from analysis.speed_error.design import PRESSURE, STEP1_FRICTION, VOID_RATIO, Case, Design
from analysis.speed_error.observables import observables
from labkit.dem import ConstantVolume, Progress, critical_time_step, read_state, side_for, velocity_gradient
from labkit.engines import FusedEngine, die_with_parent
from labkit.errors import PhysicsError
from labkit.io import write_text

SPECIMEN_COST = 0.05  # of that of a test with the specimen, about
YARDSTICK_STEPS, YARDSTICK_ROUNDS = 1500, 5


def run_study(design: Design, work: str | Path, jobs: int, progress: Progress) -> None:
    """Runs what is not there yet, `jobs` processes at a time. Raises PhysicsError if a job itself broke down."""
    work = Path(work)
    for folder in ("specimens", "runs", "results"):
        (work / folder).mkdir(parents=True, exist_ok=True)
    tasks = [(case, seed) for case in design.cases for seed in case.seeds]
    first = design.baseline(), design.baseline().seeds[0]
    make(work, *first)
    yardstick = specimen_file(work, *first)
    specimens = {specimen_file(work, *task): task for task in tasks}
    missing = [task for file, task in specimens.items() if not file.exists()]
    todo = [task for task in tasks if not result_file(work, *task).exists()]
    calls = [(make, (work, *task), SPECIMEN_COST * task[0].cost) for task in _longest_first(missing)]
    tests = [(run_case, (work, *task, yardstick), task[0].cost) for task in _longest_first(todo)]
    remaining = _Remaining(sum(cost for *_, cost in calls + tests), progress)
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(jobs, context, die_with_parent) as pool:
        _all(pool, calls, remaining, "specimens")
        _all(pool, tests, remaining, "tests")


def _longest_first(tasks):
    return sorted(tasks, key=lambda task: -task[0].cost)


def _all(pool, calls, remaining, what):
    costs = {pool.submit(function, *arguments): cost for function, arguments, cost in calls}
    try:
        for number, future in enumerate(concurrent.futures.as_completed(costs), 1):
            future.result()
            remaining.less(costs[future], f"{what}, {number} of {len(costs)}")
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise


class _Remaining:
    """Tells `progress` how much of the cost of all jobs is done."""

    def __init__(self, total, progress):
        self.total, self.done, self.progress = total, 0.0, progress

    def less(self, cost, text):
        self.done += cost
        self.progress(self.done / self.total, text)


def specimen_file(work: str | Path, case: Case, seed: int) -> Path:
    """The state file of the specimen of a case."""
    size = f"l{case.side:g}" if case.side else f"n{case.grains}"
    material = "".join(f"_{name}{value:g}" for name, value in case.material)
    return Path(work) / "specimens" / f"{size}_s{seed}{material}.state.nc"


def result_file(work: str | Path, case: Case, seed: int) -> Path:
    """The file of what came out of a case."""
    return Path(work) / "results" / f"{case.name}_{seed}.json"


def run_file(work: str | Path, case: Case, seed: int) -> Path:
    """The run file of a case."""
    return Path(work) / "runs" / f"{case.name}_{seed}.run.nc"


def make(work: str | Path, case: Case, seed: int) -> None:
    """The specimen of a case at rest at the pressure, unless it is there."""
    file = specimen_file(work, case, seed)
    if file.exists():
        return
    scene = lk.Scene(**dict(case.material))
    side = case.side or side_for(case.grains, VOID_RATIO, scene)
    recipe = lk.Recipe(VOID_RATIO, STEP1_FRICTION, side=side, seed=seed)
    lk.consolidate(lk.make_specimen(recipe, scene, progress=False), PRESSURE, file=file, progress=False)


def run_case(work: str | Path, case: Case, seed: int, yardstick: Path) -> None:
    """Runs a case with one seed and writes its result: observables, cost, and what a guard said."""
    state = case.state(read_state(specimen_file(work, case, seed)))
    file = run_file(work, case, seed)
    result = {
        "case": case.name,
        "seed": seed,
        "grains": state.number_of_grains,
        "status": "",
        "values": {},
        "time_step_over_limit": state.scene.time_step / critical_time_step(state),
    }
    before = measure_yardstick(yardstick)
    try:
        found = _run(state, case, file)
        result["values"] = observables(found.data, PRESSURE if case.path == "cp" else None)
        result |= {"wall_time": found.wall_time, "steps": found.steps}
    except PhysicsError as error:  # a guard spoke up; anything else stops the study
        result["status"] = str(error)
    result["yardstick"] = 0.5 * (before + measure_yardstick(yardstick))
    write_text(result_file(work, case, seed), json.dumps(result, indent=1))


def _run(state, case, file):
    if case.engine == "fused":  # compiles for the scene
        FusedEngine(state.replace(time_step=state.scene.time_step)).advance(1, np.zeros((3, 3)))
    return lk.run(
        state,
        case.loading(),
        case.engine,
        file,
        case.threads,
        progress=False,
        record_strain=case.record_strain,
        snapshots=case.snapshots,
        servo=case.servo,
        guarded=case.guarded,
    )


def measure_yardstick(file: str | Path) -> float:
    """Seconds of YARDSTICK_STEPS steps of a specimen, the median of some rounds."""
    state = read_state(file)
    engine, gradient = FusedEngine(state), velocity_gradient(ConstantVolume(), 1.0, state.time_step)
    engine.advance(YARDSTICK_STEPS, gradient)
    seconds = []
    for _ in range(YARDSTICK_ROUNDS):
        begin = time.perf_counter()
        engine.advance(YARDSTICK_STEPS, gradient)
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)
