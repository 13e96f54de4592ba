"""Worker processes that share a list of calls, and that stop when the study is interrupted."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Any

from labkit.errors import Interrupted, PhysicsError
from labkit.process import die_with_parent

Call = tuple[Callable[..., object], tuple[Any, ...]]  # a function and its arguments

PATIENCE = 5.0  # seconds that a worker has to save its run before it is killed
INTERVAL = 1.0  # seconds between checks of the workers: the pool does not notice every death


def run_calls(calls: Sequence[Call], number: int) -> Generator[int, None, None]:
    """Runs all calls in `number` worker processes and yields the index of each call when it has finished.

    The calls start in the given order. An error in a call is raised here. Raises PhysicsError if a worker dies. On any
    exception, KeyboardInterrupt included, all workers have ended before it propagates.
    """
    pool = ProcessPoolExecutor(number, multiprocessing.get_context("spawn"), initializer=_begin)
    with _stopped(pool) as workers:
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited by the workers, which ignore Ctrl-C
        try:
            futures = {pool.submit(_call, *call): index for index, call in enumerate(calls)}
        finally:
            signal.signal(signal.SIGINT, handler)
        try:
            waiting = set(futures)
            while waiting:
                known = workers()
                done, waiting = wait(waiting, INTERVAL, FIRST_COMPLETED)
                for future in done:
                    future.result()
                    yield futures[future]
                if not known <= workers():
                    raise BrokenProcessPool
        except BrokenProcessPool:
            raise PhysicsError("a worker process died; the same command resumes the study") from None


def _begin() -> None:
    """Lets a worker end with the study, and leaves Ctrl-C to the study also while a run catches signals."""
    die_with_parent()
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT,))


def _call(function: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    try:
        function(*arguments)
    except Interrupted as interrupted:  # a signal to this process alone
        os._exit(interrupted.code)


@contextlib.contextmanager
def _stopped(pool: ProcessPoolExecutor) -> Iterator[Callable[[], set[BaseProcess]]]:
    """Yields a function that returns the living workers, and ends them.

    They get SIGTERM, at which a run saves its state and stops, and SIGKILL after PATIENCE seconds.
    """
    others = set(multiprocessing.active_children())
    try:
        yield lambda: set(multiprocessing.active_children()) - others
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        workers = set(multiprocessing.active_children()) - others
        for worker in workers:
            worker.terminate()
        deadline = time.monotonic() + PATIENCE
        for worker in workers:
            worker.join(max(0.0, deadline - time.monotonic()))
            worker.kill()
