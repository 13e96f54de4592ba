"""Runs many tests at once from Python.

for outcome in labkit.run_many([(state, path), (other, another)]):
    outcome.run, outcome.failure
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path as File
from typing import NamedTuple, TypeAlias

from labkit.engines import Device, device_of
from labkit.engines.base import Progress
from labkit.errors import InputError, PhysicsError, warn
from labkit.grains.state import State
from labkit.paths.path import Path
from labkit.process.interruption import stop_on_signals
from labkit.process.system import number_of_cores
from labkit.records.schedule import Options
from labkit.results.run import Run
from labkit.servo.correction import STANDARD, Servo
from labkit.simulation.api import is_begun, progress_function, result_of
from labkit.simulation.tasks import RunTask, execute

Test: TypeAlias = tuple[State, Path]


class Outcome(NamedTuple):
    """The result of one of several tests.

    `run` is the Run, up to the point of failure if it failed, or None if it failed before its first record. `failure`
    is one sentence that says why it failed, or empty.
    """

    run: Run | None
    failure: str


def run_many(
    tests: Iterable[Test],
    folder: str | os.PathLike[str] | None = None,
    *,
    engine: str | Device = "fused",
    progress: bool | Progress = True,
    workers: int | None = None,
    record_strain: float | str | None = None,
    snapshots: int | str = Options.snapshots,
    save_every: int | str | None = None,
    stop_when: str | None = None,
    inertial_number: float | str | None = None,
    servo: Servo = STANDARD,
    guarded: bool = True,
) -> list[Outcome]:
    """Load specimens along paths, several at a time; returns an Outcome per test, in the order of the tests.

    Each test runs on one thread. A test that fails does not stop the others. With a folder, unfinished runs are resumed
    and finished runs are not repeated; without a folder, the runs stay in memory. Raises InputError, before any test
    starts, if a test cannot be started, and Interrupted after Ctrl-C or SIGTERM, with checkpoints in the files, if any.

    Args:
        tests: (specimen, path) of each test; the number of grains, the scene and the path may differ.
        folder: Folder for the run files 0.run.nc, 1.run.nc, ...
        workers: Number of tests that run at the same time (default: one for each core).
        engine: Engine, or its name.
        progress: True to show the progress, or a function of the completed fraction and a text.
        record_strain: As in labkit.Options.
        snapshots: As in labkit.Options.
        save_every: As in labkit.Options.
        stop_when: As in labkit.Options.
        inertial_number: As in labkit.Options.
        servo: As in labkit.Options.
        guarded: As in labkit.Options.
    """
    options = Options(record_strain, snapshots, save_every, stop_when, inertial_number, servo, guarded)
    pairs, device = list(tests) if isinstance(tests, Iterable) else [tests], device_of(engine)
    if not all(isinstance(pair, Sequence) and len(pair) == 2 for pair in pairs):
        raise InputError("are not pairs", field="tests", allowed="a list of (state, path)")
    tasks = list[RunTask]()
    for number, (state, path) in enumerate(pairs):
        file = None if folder is None else str(File(folder) / f"{number}.run.nc")
        tasks.append(RunTask(state=state, path=path, device=device, output=file, options=options))
    warn(*(task.warning for task in tasks))
    show, outcomes = progress_function(progress, "tests"), list[Outcome]()
    for task, failure in zip(tasks, _failures(tasks, workers), strict=True):
        outcomes.append(Outcome(result_of(task) if is_begun(task) else None, failure))
        show(len(outcomes) / len(tasks), f"{len(outcomes)} of {len(tasks)} done")
    return outcomes


def _failures(tasks: Sequence[RunTask], workers: int | None) -> Iterator[str]:
    """Execute runs; yield the `failure` of each Outcome, in order. Raises Interrupted."""
    with stop_on_signals(), ThreadPoolExecutor(workers or number_of_cores()) as pool:
        try:
            yield from pool.map(_failure, tasks)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _failure(task: RunTask) -> str:
    """Execute one run; return the sentence that says why it failed, or nothing."""
    try:
        execute(task)
    except (InputError, PhysicsError) as error:
        return str(error)
    return ""
