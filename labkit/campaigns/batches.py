"""Batches of a campaign: runs that an engine advances together on one GPU, as one job.

The job loads all runs of a batch and leaves each in the folder of unfinished runs, complete or not. The job of each run
then finds its file there, and moves a finished run into place or reports why it failed.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from labkit.campaigns.items import PlannedRun
from labkit.campaigns.plan import BATCHES, Job, Plan
from labkit.engines import ENGINES
from labkit.engines.base import MOST_THREADS
from labkit.errors import InputError, Interrupted, PhysicsError, sentence
from labkit.io.atomic import require_no_link
from labkit.runs.batch import execute_together, packed
from labkit.runs.tasks import RunTask

GB = 1e9


@dataclass(frozen=True)
class RunBatch:
    """Runs that are carried out together.

    The `name` depends on the runs and their parameters; `memory` is roughly the number of bytes needed on the GPU.
    """

    name: str
    jobs: tuple[Job, ...]
    memory: float

    @property
    def threads(self) -> int:
        """Threads that compute the records of its runs."""
        return min(len(self.jobs), MOST_THREADS)

    @property
    def mark(self) -> str:
        """Path of an empty file, written once all runs have been tried."""
        return f"{BATCHES}/{self.name}.done"


def can_batch(job: Job) -> bool:
    """True if a job is a run of a specimen on an engine that advances runs together."""
    return job.kind == "run" and on_gpu(job) and str(job.source).endswith(".state.nc")


def on_gpu(job: Job) -> bool:
    """True if a job needs the GPU."""
    return ENGINES[job.item.engine].abilities.batches is not None


def batches_of(plan: Plan) -> tuple[RunBatch, ...]:
    """Divide the runs of a plan into as few batches as fit the GPU's memory, by default that of this computer's GPU.

    Raises InputError if the campaign file does not give the memory and this computer has no GPU.
    """
    groups: dict[tuple[str, str], list[Job]] = defaultdict(list)
    for job in filter(can_batch, plan.runs):
        groups[job.item.engine, job.item.precision].append(job)
    batches = []
    for (name, precision), jobs in groups.items():
        engine, given = ENGINES[name].abilities.batches, plan.campaign.gpu_memory
        assert engine is not None  # `can_batch`
        room = engine.room() if given is None else given * GB
        keys, sizes = [], []
        for job in jobs:
            run = job.item
            assert isinstance(run, PlannedRun)
            origin = plan.campaign.origin(run.specimen)
            keys.append(engine.key(run.scene(origin)))
            sizes.append(engine.memory(origin.expected_grains, precision))
        for numbers in packed(keys, sizes, room):
            chosen = tuple(jobs[number] for number in numbers)
            digest = hashlib.sha256("".join(job.digest for job in chosen).encode()).hexdigest()
            batches.append(RunBatch(f"{name}-{digest[:12]}", chosen, sum(sizes[number] for number in numbers)))
    return tuple(batches)


def carry_out(batch: RunBatch, task_of: Callable[[Job], RunTask]) -> None:
    """Carry out the unfinished runs of a batch in the campaign folder, and write the mark.

    A failure is written to the log of the run, and does not stop the others. Raises Interrupted after a signal, once
    the runs have written their checkpoints.
    """
    tasks: dict[Job, RunTask] = {}
    for job in filter(_is_due, batch.jobs):
        try:
            tasks[job] = task_of(job)
        except (InputError, PhysicsError) as error:
            _log(job, f"labkit: {sentence(error)}")
        else:
            _log(job, f"in the batch {batch.name} of {len(batch.jobs)} runs")
    try:
        failures = execute_together(list(tasks.values()))
    except (InputError, PhysicsError, Interrupted, MemoryError) as error:
        for job in tasks:
            _log(job, f"labkit: {sentence(error)}")
        raise
    for job, failure in zip(tasks, failures, strict=True):
        _log(job, f"{job.unfinished}: complete" if failure is None else f"labkit: {sentence(failure)}")
    mark = Path(batch.mark)
    mark.parent.mkdir(exist_ok=True)
    mark.touch()


def _is_due(job: Job) -> bool:
    """True unless the result of a run exists and is newer than its source."""
    with contextlib.suppress(FileNotFoundError):
        made = os.stat(job.output).st_mtime
        return any(os.stat(file).st_mtime > made for file in job.inputs)
    return True


def _log(job: Job, line: str) -> None:
    require_no_link(job.log)
    with open(job.log, "a") as log:
        print(line, file=log)
