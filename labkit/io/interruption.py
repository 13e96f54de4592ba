"""Signals that ask a run to stop, and the lock that prevents two runs from writing the same file."""

from __future__ import annotations

import contextlib
import fcntl
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from labkit.errors import InputError


class Signals:
    """caught: number of the last signal received; 0 if none was received."""

    caught = 0


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Signals]:
    """Context in which SIGINT and SIGTERM only store their number in the Signals object.

    Python lets only the main thread handle signals: in other threads, none are caught.
    """
    signals = Signals()

    def catch(number: int, frame: FrameType | None) -> None:
        signals.caught = number

    chosen = (signal.SIGINT, signal.SIGTERM) if threading.current_thread() is threading.main_thread() else ()
    before = {number: signal.signal(number, catch) for number in chosen}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


@contextlib.contextmanager
def only_writer(file: Path) -> Iterator[None]:
    """Context with the lock on `file`, which the kernel releases if the process is killed.

    Raises InputError if another process is writing `file`.
    """
    lock = lock_of(file)
    with open(lock, "w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise busy(file) from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def busy(file: Path) -> InputError:
    """The error for a file that another process is writing."""
    return InputError(f"{file} is being written by another process: wait for it, or choose another -o")


def lock_of(file: Path) -> Path:
    """Path of the lock file of `file`."""
    return file.with_name(f".{file.name}.lock")


def being_written(file: Path) -> bool:
    """True if a process is currently writing `file`."""
    try:
        with open(lock_of(file)) as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False
