"""The runs of a study: each a process of its own, each kept in a folder, so that a study goes on where it was cut off.

Wall time is compared with a yardstick: steps of the baseline's first specimen, timed just before and after the run
in the same process. What else the machine does slows down both.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import multiprocessing
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import labkit
from labkit.dem.consolidation import consolidate
from labkit.engines.fused import FusedEngine
from labkit.engines.yade_process import die_with_parent
from labkit.errors import InputError, PhysicsError
from labkit.io.files import write_text
from labkit.dem.paths import ConstantVolume
from labkit.dem.scene import Scene
from labkit.dem.servo import velocity_gradient
from labkit.dem.simulation import run
from labkit.dem.specimen import Recipe, make_specimen, side_for
from labkit.dem.state import read_state, write_state
from labkit.study.design import PRESSURE, STEP1_FRICTION, VOID_RATIO
from labkit.study.observables import observables
from labkit.dem.time_step import critical_time_step

SPECIMEN_COST = 0.05  # of that of a test with the specimen, about
YARDSTICK_STEPS, YARDSTICK_ROUNDS = 1500, 5


def run_study(design, work, jobs, progress):
    """Runs what is not there yet, `jobs` processes at a time. Raises PhysicsError when a job itself broke down."""
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


def specimen_file(work, case, seed):
    size = f"l{case.side:g}" if case.side else f"n{case.grains}"
    material = "".join(f"_{name}{value:g}" for name, value in case.material)
    return Path(work) / "specimens" / f"{size}_s{seed}{material}.state.nc"


def result_file(work, case, seed):
    return Path(work) / "results" / f"{case.name}_{seed}.json"


def run_file(work, case, seed):
    return Path(work) / "runs" / f"{case.name}_{seed}.run.nc"


def make(work, case, seed):
    """The specimen of a case at rest at the pressure, unless it is there."""
    file = specimen_file(work, case, seed)
    if file.exists():
        return
    scene = Scene(**dict(case.material))
    side = case.side or side_for(case.grains, VOID_RATIO, scene)
    recipe = Recipe(VOID_RATIO, STEP1_FRICTION, side=side, seed=seed)
    state = make_specimen(scene, recipe, "fused")
    state = consolidate(state, PRESSURE, "fused")
    write_state(file, state.replace(recipe=json.dumps(dataclasses.asdict(recipe))))


def run_case(work, case, seed, yardstick):
    """Runs a case with one seed and writes its result: observables, cost, and what a guard said."""
    state = case.state(read_state(specimen_file(work, case, seed)))
    file = run_file(work, case, seed)
    result = {
        "case": case.name, "seed": seed, "grains": state.number_of_grains, "status": "", "values": {},
        "time_step_over_limit": state.scene.time_step / critical_time_step(state),
    }  # fmt: skip
    before = measure_yardstick(yardstick)
    try:
        _run(state, case, file)
        found = labkit.open_run(file)
        result["values"] = observables(found, PRESSURE if case.path == "cp" else None)
        result |= {"wall_time": float(found.attrs["wall_time"]), "steps": int(found.attrs["steps"])}
        found.close()
    except PhysicsError as error:  # a guard spoke up; anything else stops the study
        result["status"] = str(error)
    result["yardstick"] = 0.5 * (before + measure_yardstick(yardstick))
    write_text(result_file(work, case, seed), json.dumps(result, indent=1))


def _run(state, case, file):
    if case.engine == "yade":
        _run_in_yade(state, case, file)
        return
    FusedEngine(state.replace(time_step=state.scene.time_step)).advance(1, np.zeros((3, 3)))  # compiles for the scene
    run(
        state, case.loading(), file, case.engine, case.threads, case.record_strain, case.snapshots,
        servo=case.servo, guarded=case.guarded,
    )  # fmt: skip


def _run_in_yade(state, case, file):
    start = file.with_name(file.name.replace(".run.nc", ".state.nc"))
    if not start.exists():
        write_state(start, state)
    options = {"pressure": PRESSURE, "rate": case.rate, "strain": case.strain, "record-strain": case.record_strain,
               "snapshots": case.snapshots, "engine": "yade", "threads": case.threads, "output": file}  # fmt: skip
    words = ["run", case.path, start, *(f"--{name}={value}" for name, value in options.items())]
    command = [sys.executable, "-m", "labkit.cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=die_with_parent)
    if done.returncode:
        raise (PhysicsError if done.returncode == 1 else InputError)(done.stderr.strip().splitlines()[-1])


def measure_yardstick(file):
    """Seconds of YARDSTICK_STEPS steps of a specimen, the median of some rounds."""
    state = read_state(file)
    machine, gradient = FusedEngine(state), velocity_gradient(ConstantVolume(), 1.0, state.time_step)
    machine.advance(YARDSTICK_STEPS, gradient)
    seconds = []
    for _ in range(YARDSTICK_ROUNDS):
        begin = time.perf_counter()
        machine.advance(YARDSTICK_STEPS, gradient)
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)
