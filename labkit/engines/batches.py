"""Runs that an engine advances together, in batches that fit its memory."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence

from labkit.dem.engine import Progress, Start, silent
from labkit.engines.tasks import RunTask, execute, require_possible
from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io.blas import one_blas_thread
from labkit.io.interruption import stop_on_signals

MOST_THREADS = 8  # that compute records of a batch; one record of 14,000 grains takes one of them tens of milliseconds


def packed(keys: Sequence[Hashable], sizes: Sequence[float], room: float) -> list[list[int]]:
    """Batches of items, by their numbers: those of a batch have equal keys, and sizes that add up to `room` at most.

    An item that is larger than the room is alone in its batch. The batches are filled with the largest items first.
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
    """Execute runs on the engine of the first: in batches if it can, or one after the other.

    Returns for each run the exception that ended it, or None; the others are not affected. Raises InputError if the
    engine cannot execute one of them, Interrupted after a signal, once the runs have written their checkpoints.
    """
    shown = list(progress) or [silent] * len(tasks)
    kinds = [require_possible(task) for task in tasks]
    if not kinds or not kinds[0].batches:
        return [_alone(*one) for one in zip(tasks, shown, strict=True)]
    engine, precision = kinds[0], tasks[0].precision
    keys = [engine.batch_key(task.scene) for task in tasks]
    sizes = [engine.batch_memory(task.state.number_of_grains, precision) for task in tasks]
    failures: list[Exception | None] = [None] * len(tasks)
    with stop_on_signals() as signals, one_blas_thread():
        for batch in packed(keys, sizes, engine.batch_room()):
            works = [_work(tasks[number], shown[number]) for number in batch]
            for number, failure in zip(batch, engine.together(works, precision), strict=True):
                failures[number] = failure
            if signals.caught:
                raise Interrupted(f"stopped by signal {signals.caught}; the runs are saved", 128 + signals.caught)
    return failures


def _alone(task: RunTask, progress: Progress) -> Exception | None:
    """Execute one run; returns the InputError or PhysicsError that ended it, or None."""
    try:
        execute(task, progress)
    except (InputError, PhysicsError) as error:
        return error
    return None


def _work(task: RunTask, progress: Progress) -> Callable[[Start], None]:
    """What an engine does for a run of a batch."""
    return lambda start: task.do_with(start, progress)
