"""Runs that an engine advances together, in batches that fit its memory."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Sequence

from labkit.engines.base import Progress, silent
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.blas import one_blas_thread
from labkit.io.interruption import stop_on_signals
from labkit.runs.tasks import RunTask, execute, require_possible


def packed(keys: Sequence[Hashable], sizes: Sequence[float], room: float) -> list[list[int]]:
    """Pack items, given by number, into batches with equal keys and sizes that add up to `room` at most.

    An item larger than `room` is alone in its batch. The batches are filled with the largest items first.
    """
    batches: dict[Hashable, list[list[int]]] = defaultdict(list)
    for number in sorted(range(len(keys)), key=lambda number: -sizes[number]):
        of_key = batches[keys[number]]
        fitting = (one for one in of_key if sum(sizes[other] for other in one) + sizes[number] <= room)
        batch = next(fitting, None)
        if batch is None:
            of_key.append([number])
        else:
            batch.append(number)
    return sorted(sorted(batch) for of_key in batches.values() for batch in of_key)


def execute_together(tasks: Sequence[RunTask], progress: Sequence[Progress] = ()) -> list[Exception | None]:
    """Execute runs on the engine of the first run, in batches if it supports them, otherwise one after the other.

    Returns for each run the exception that ended it, or None; the others are not affected. Raises InputError if the
    engine cannot execute one of them, Interrupted after a signal, once the runs have written their checkpoints.
    """
    shown = list(progress) or [silent] * len(tasks)
    kinds = [require_possible(task) for task in tasks]
    batches = kinds[0].abilities.batches if kinds else None
    if batches is None:
        return [alone(*one) for one in zip(tasks, shown, strict=True)]
    precision = tasks[0].start.precision
    keys = [batches.key(task.scene) for task in tasks]
    sizes = [batches.memory(task.state.number_of_grains, precision) for task in tasks]
    failures: list[Exception | None] = [None] * len(tasks)
    with stop_on_signals() as signals, one_blas_thread():
        for batch in packed(keys, sizes, batches.room()):
            runs = [tasks[number].run(shown[number]) for number in batch]
            for number, failure in zip(batch, batches.drive(runs, precision), strict=True):
                failures[number] = failure
            if signals.caught:
                raise Interrupted(f"stopped by signal {signals.caught}; the runs are saved", 128 + signals.caught)
    return failures


def alone(task: RunTask, progress: Progress = silent) -> Exception | None:
    """Execute one run; returns the InputError or PhysicsError that ended it, or None."""
    try:
        execute(task, progress)
    except (InputError, PhysicsError) as error:
        return error
    return None
