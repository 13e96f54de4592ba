"""Signals that ask a run to stop, and the lock that keeps two runs from one file."""

from __future__ import annotations

import contextlib
import fcntl
import signal

from labkit.errors import InputError


class Signals:
    """`caught` is the number of the signal that asks to stop, 0 before."""

    caught = 0


@contextlib.contextmanager
def stop_on_signals():
    """While it lasts, SIGINT and SIGTERM only leave their number in the Signals that it gives."""
    signals = Signals()

    def catch(number, frame):
        signals.caught = number

    before = {number: signal.signal(number, catch) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


@contextlib.contextmanager
def only_writer(file):
    """Raises InputError when another process writes `file`. The kernel lifts the lock of a killed process."""
    lock = file.with_name(f".{file.name}.lock")
    with open(lock, "w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{file} is being written by another process: wait for it, or give another -o") from None
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)
