"""Worker processes that share a list of calls, and that stop when the study is interrupted."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from labkit.errors import Interrupted, PhysicsError
from labkit.io import die_with_parent

Call = tuple[Callable[..., object], tuple[Any, ...]]  # a function and its arguments

PATIENCE = 5.0  # seconds that a worker has to save its run before it is killed


def run_calls(calls: Sequence[Call], number: int) -> Iterator[int]:
    """Runs all calls in `number` worker processes and yields the index of each call when it has finished.

    The calls start in the given order. An error in a call is raised here. Raises PhysicsError if a worker dies. On any
    exception, KeyboardInterrupt included, all workers have ended before it propagates.
    """
    pool = ProcessPoolExecutor(number, multiprocessing.get_context("spawn"), initializer=die_with_parent)
    with _stopped(pool):
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # for the workers: only this process reacts to Ctrl-C
        try:
            futures = {pool.submit(_call, *call): index for index, call in enumerate(calls)}
        finally:
            signal.signal(signal.SIGINT, handler)
        try:
            for future in as_completed(futures):
                future.result()
                yield futures[future]
        except BrokenProcessPool:
            raise PhysicsError("a worker process died; the same command resumes the study") from None


def _call(function: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    try:
        function(*arguments)
    except Interrupted as interrupted:  # by a signal to this process only
        os._exit(interrupted.code)


@contextlib.contextmanager
def _stopped(pool: ProcessPoolExecutor) -> Iterator[None]:
    """Ends the workers: SIGTERM, at which a run saves its state and stops; SIGKILL after PATIENCE seconds."""
    others = set(multiprocessing.active_children())
    try:
        yield
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        workers = set(multiprocessing.active_children()) - others
        for worker in workers:
            worker.terminate()
        deadline = time.monotonic() + PATIENCE
        for worker in workers:
            worker.join(max(0.0, deadline - time.monotonic()))
            worker.kill()
