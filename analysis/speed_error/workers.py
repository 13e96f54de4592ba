"""Worker processes that share a list of calls, and that stop when the study is interrupted."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import multiprocessing.process
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

from labkit.errors import InputError, Interrupted, PhysicsError
from labkit.io import die_with_parent

Call = tuple[Callable[..., object], tuple[Any, ...]]  # a function and its arguments
Connection = multiprocessing.connection.Connection
Workers = dict[Connection, multiprocessing.process.BaseProcess]

PATIENCE = 5.0  # seconds that a worker has to save its run before it is killed


def run_calls(calls: Sequence[Call], number: int) -> Iterator[int]:
    """Runs all calls in `number` worker processes and yields the index of each call when it has finished.

    The calls start in the given order. An error in a call is raised here. Raises PhysicsError if a worker dies. On any
    exception, KeyboardInterrupt included, all workers have ended before it propagates.
    """
    waiting = iter(range(len(calls)))
    with _workers(min(number, len(calls))) as workers:
        running = {worker: index for worker, index in zip(workers, waiting, strict=False)}
        for worker, index in running.items():
            worker.send(calls[index])
        while running:
            for worker in cast(list[Connection], multiprocessing.connection.wait(list(running))):
                error = _answer(worker, workers[worker])
                if error is not None:
                    raise error
                finished = running.pop(worker)
                following = next(waiting, None)
                if following is not None:
                    running[worker] = following
                    worker.send(calls[following])
                yield finished


def _answer(worker: Connection, process: multiprocessing.process.BaseProcess) -> BaseException | None:
    try:
        return worker.recv()
    except (EOFError, ConnectionResetError):
        process.join()
        return PhysicsError(
            f"a worker process died (exit status {process.exitcode}); the same command resumes the study"
        )


@contextlib.contextmanager
def _workers(number: int) -> Iterator[Workers]:
    """Starts the workers, and stops them at the end."""
    workers: Workers = {}
    try:
        for _ in range(number):
            _start(workers)
        yield workers
    finally:
        _stop(workers)


def _start(workers: Workers) -> None:
    """Starts one more worker. It inherits that SIGINT is ignored: only this process reacts to Ctrl-C."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), daemon=True)
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process.start()
        workers[here] = process
    finally:
        signal.signal(signal.SIGINT, handler)
    there.close()


def _serve(connection: Connection) -> None:
    """Runs the calls that arrive and sends back None or the error of each."""
    die_with_parent()
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        error: BaseException | None = None
        try:
            function(*arguments)
        except (InputError, PhysicsError) as refused:
            error = refused
        except Interrupted as interrupted:  # by a signal to this process only
            sys.exit(interrupted.code)
        except Exception as unexpected:
            error = RuntimeError(f"a worker process failed:\n{''.join(traceback.format_exception(unexpected))}")
        connection.send(error)


def _stop(workers: Workers) -> None:
    """Ends the workers: SIGTERM, at which a run saves its state and stops; SIGKILL after PATIENCE seconds."""
    for process in workers.values():
        process.terminate()
    deadline = time.monotonic() + PATIENCE
    for process in workers.values():
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()
    for connection in workers:
        connection.close()
