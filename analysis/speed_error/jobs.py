"""The specimens and runs of a study, made in worker processes and kept in a folder, so that a study can be resumed.

Wall time is compared with a yardstick: steps of the baseline's first specimen, timed in the same process just before
and after the run. Other load on the computer slows down both.
"""

from __future__ import annotations

import contextlib
import json
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from analysis.speed_error.design import PRESSURE, RATE, STEP1_FRICTION, VOID_RATIO, Case, Design
from analysis.speed_error.observables import observables
from analysis.speed_error.workers import run_calls
from labkit.engines import Device, FusedEngine, Progress
from labkit.errors import PhysicsError
from labkit.files import write_text
from labkit.grains import State, critical_time_step, read_state
from labkit.paths import ConstantVolume
from labkit.servo import prescribed_gradient
from labkit.specimens import side_for

SPECIMEN_COST = 0.05  # approximate cost of making a specimen, as a fraction of a test on it
YARDSTICK_ROUNDS = 5

Task = tuple[Case, int]  # a case and a seed
Job = tuple[Callable[..., object], tuple[Any, ...], float]  # a function, its arguments, its cost


def run_study(design: Design, work: str | Path, jobs: int, progress: Progress) -> None:
    """Makes the specimens and runs that the folder `work` lacks, `jobs` at a time.

    Raises PhysicsError if a worker process fails. On KeyboardInterrupt the worker processes are stopped before the
    exception propagates.
    """
    work = Path(work)
    for folder in ("specimens", "runs", "results"):
        (work / folder).mkdir(parents=True, exist_ok=True)
    tasks = [(case, seed) for case in design.cases for seed in case.seeds]
    first = design.baseline(), design.baseline().seeds[0]
    make(work, *first)
    yardstick = specimen_file(work, *first)
    todo = [task for task in tasks if not result_file(work, *task).exists()]
    specimens = {specimen_file(work, *task): task for task in [first, *todo]}
    missing = [task for file, task in specimens.items() if not file.exists()]
    makes: list[Job] = [(make, (work, *task), SPECIMEN_COST * task[0].cost) for task in _longest_first(missing)]
    steps = design.yardstick_steps
    tests: list[Job] = [(run_case, (work, *task, yardstick, steps), task[0].cost) for task in _longest_first(todo)]
    total = sum(cost for *_, cost in makes + tests)
    done = 0.0
    for name, batch in (("specimens", makes), ("tests", tests)):
        with contextlib.closing(run_calls([job[:2] for job in batch], jobs)) as ended:
            for count, index in enumerate(ended, 1):
                done += batch[index][2]
                progress(done / total, f"{name}, {count} of {len(batch)}")


def _longest_first(tasks: Iterable[Task]) -> Sequence[Task]:
    return sorted(tasks, key=lambda task: -task[0].cost)


def specimen_file(work: str | Path, case: Case, seed: int) -> Path:
    """The state file of the specimen of a case."""
    size = f"l{case.side:g}" if case.side else f"n{case.grains}"
    material = "".join(f"_{name}{value:g}" for name, value in case.material)
    return Path(work) / "specimens" / f"{size}_s{seed}{material}.state.nc"


def result_file(work: str | Path, case: Case, seed: int) -> Path:
    """The result file of a case."""
    return Path(work) / "results" / f"{case.name}_{seed}.json"


def run_file(work: str | Path, case: Case, seed: int) -> Path:
    """The run file of a case."""
    return Path(work) / "runs" / f"{case.name}_{seed}.run.nc"


def make(work: str | Path, case: Case, seed: int) -> Path:
    """Makes the specimen of a case, at rest at PRESSURE, unless its file exists; returns the file."""
    file = specimen_file(work, case, seed)
    if file.exists():
        return file
    scene = lk.Scene(**dict(case.material))
    side = case.side or side_for(case.grains, VOID_RATIO, scene)
    recipe = lk.Recipe(VOID_RATIO, STEP1_FRICTION, side=side, seed=seed, cell="fixed")
    lk.consolidate(lk.make_specimen(recipe, scene, progress=False), PRESSURE, file=file, progress=False)
    return file


def run_case(work: str | Path, case: Case, seed: int, yardstick: Path, steps: int) -> None:
    """Runs a case with one seed and writes its result: observables, cost, and any error that stopped the run.

    `yardstick`, `steps`: specimen and number of steps of the yardstick.
    """
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
    before = measure_yardstick(yardstick, steps)
    try:
        run = _run(state, case, file)
        result["values"] = observables(run.data, PRESSURE if case.path == "cp" else None)
        result |= {"wall_time": run.wall_time, "steps": run.steps}
    except PhysicsError as error:  # a check has stopped the run; any other error stops the study
        result["status"] = str(error)
    result["yardstick"] = 0.5 * (before + measure_yardstick(yardstick, steps))
    write_text(result_file(work, case, seed), json.dumps(result, indent=1))


def _run(state: State, case: Case, file: Path) -> lk.Run:
    if case.engine == "fused":  # compile before the run is timed
        FusedEngine(state.replace(time_step=state.scene.time_step)).advance(1, np.zeros((3, 3)))
    return lk.run(
        state,
        case.loading(),
        engine=Device(case.engine, case.threads, case.precision),
        file=file,
        progress=False,
        inertial_number=case.inertial_number,
        record_strain=case.record_strain,
        snapshots=case.snapshots,
        servo=case.servo,
        guarded=case.guarded,
    )


def measure_yardstick(file: str | Path, steps: int) -> float:
    """Time of a number of steps of a specimen, s: the median of YARDSTICK_ROUNDS rounds."""
    state = read_state(file)
    engine, gradient = FusedEngine(state), prescribed_gradient(ConstantVolume(RATE), state.time_step)
    engine.advance(steps, gradient)
    seconds = []
    for _ in range(YARDSTICK_ROUNDS):
        start = time.perf_counter()
        engine.advance(steps, gradient)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)
