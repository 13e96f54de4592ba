"""Signals that ask a run to stop, and the lock that keeps two runs from one file."""

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
    """`caught` is the number of the signal that asks to stop, 0 before."""

    caught = 0


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Signals]:
    """While it lasts, SIGINT and SIGTERM only leave their number in the Signals that it gives.

    Python lets the main thread alone handle signals: in another thread nothing is caught.
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
    """Raises InputError if another process writes `file`. The kernel lifts the lock of a killed process."""
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
    """The error of a file that another process writes."""
    return InputError(f"{file} is being written by another process: wait for it, or choose another -o")


def lock_of(file: Path) -> Path:
    """The lock file beside `file`."""
    return file.with_name(f".{file.name}.lock")


def being_written(file: Path) -> bool:
    """Whether a process writes `file` now."""
    try:
        with open(lock_of(file)) as handle:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False
