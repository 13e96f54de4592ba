"""Signals that ask a run to stop, and the lock that prevents two runs from writing the same file."""

from __future__ import annotations

import contextlib
import errno
import functools
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import IO

from labkit.errors import InputError, Interrupted, exit_code, notice
from labkit.process.system import lock_file, open_flags

ECHO = 1.0  # s; a signal so soon after the first is the same request: `timeout` and terminals send two


class Signals:
    """The number of the last signal received, `caught`, or 0; `first` is the time (s) of the first.

    `repeated` is True if another signal followed, later than an echo of the first.
    """

    caught, first, repeated = 0, math.inf, False

    def catch(self, number: int, frame: FrameType | None = None) -> None:
        """Note a signal; this is a signal handler."""
        now = time.monotonic()
        self.first = min(self.first, now)
        self.caught, self.repeated = number, self.repeated or now - self.first > ECHO

    @property
    def age(self) -> float:
        """Time since the first signal (s); negative if there was none."""
        return time.monotonic() - self.first


@contextlib.contextmanager
def stop_on_signals() -> Iterator[Signals]:
    """Context in which SIGINT, SIGTERM and SIGHUP are only noted in the Signals object.

    A signal that nothing in the context answers by an exception is delivered at its end: it may concern more than the
    run that was just completed. A context inside another one shares the Signals object of the outer context, even in a
    different thread. Only the main thread can handle signals in Python: in any other thread, a context without an outer
    one catches no signals.
    """
    if _CAUGHT:
        yield _CAUGHT[0]
        return
    signals = Signals()
    with catch_signals((signal.SIGINT, *ending_signals()), signals.catch):
        if threading.current_thread() is threading.main_thread():
            _CAUGHT.append(signals)
        try:
            yield signals
        finally:
            if signals in _CAUGHT:
                _CAUGHT.remove(signals)
    if signals.caught == signal.SIGINT:
        raise KeyboardInterrupt
    if signals.caught:
        signal.raise_signal(signals.caught)


_CAUGHT: list[Signals] = []  # the Signals object of the main thread while it catches signals


@contextlib.contextmanager
def end_on_signals() -> Iterator[None]:
    """Context in which SIGTERM and SIGHUP raise Interrupted, so that no temporary file is left behind.

    Python ignores an exception raised within `__del__`; the signal is then sent again a moment later. An echo of a
    signal is ignored, so that it does not interrupt the end.
    """
    within, report, signals = [True], sys.unraisablehook, Signals()

    def stop(number: int, frame: FrameType | None) -> None:
        first = not signals.caught
        signals.catch(number)
        if first or signals.repeated:
            raise Interrupted(f"stopped by signal {number}; no unfinished file is left", 128 + number)

    def repeat(ignored: sys.UnraisableHookArgs) -> None:
        if not isinstance(ignored.exc_value, Interrupted):
            report(ignored)
            return
        number, signals.caught = ignored.exc_value.code - 128, 0
        timer = threading.Timer(0.01, lambda: os.kill(os.getpid(), number) if within else None)
        timer.daemon = True
        timer.start()

    with catch_signals(ending_signals(), stop):
        sys.unraisablehook = repeat
        try:
            yield
        finally:
            sys.unraisablehook = report
            within.clear()


@contextlib.contextmanager
def resumed_from(place: str | os.PathLike[str]) -> Iterator[None]:
    """Context in which a signal raises Interrupted, with the file or folder from which the same command goes on."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise Interrupted(f"interrupted; repeat the same command to resume ({place})", exit_code(error)) from None


def nothing_saved(number: int) -> Interrupted:
    """Return the error of a run without a file that was stopped by a signal."""
    return Interrupted("stopped by a signal; nothing was saved, because the run has no file", 128 + number)


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return SIGTERM, and SIGHUP unless this process ignores it, as after `nohup`."""
    if not hasattr(signal, "SIGHUP"):  # Windows
        return (signal.SIGTERM,)
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGTERM,) if ignored else (signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def catch_signals(numbers: Iterable[int], handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Context in which `handler` handles signals; it has no effect outside the main thread, as Python requires.

    A Ctrl-C caught here ends a process whose handler is interrupt_once, so that further ones are ignored afterwards.
    """
    chosen = numbers if threading.current_thread() is threading.main_thread() else ()
    caught: set[int] = set()

    def note(number: int, frame: FrameType | None) -> None:
        caught.add(number)
        handler(number, frame)

    before = {number: signal.signal(number, note) for number in chosen}
    try:
        yield
    finally:
        for number, earlier in before.items():
            ends = earlier is interrupt_once and number in caught
            signal.signal(number, signal.SIG_IGN if ends else signal.SIG_DFL if earlier is None else earlier)


def interrupt_once(number: int, frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt, and ignore the signal from then on: this is a handler of a process that it ends.

    A second Ctrl-C while the process ends, such as that of `timeout`, would print a traceback.
    """
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


@contextlib.contextmanager
def delay_interrupts() -> Iterator[None]:
    """Context that delays Ctrl-C until it ends: interrupting the import of a library leaves it broken."""
    caught: list[int] = []
    with catch_signals((signal.SIGINT,), lambda number, _: caught.append(number)):
        yield
    if caught:
        raise KeyboardInterrupt


@contextlib.contextmanager
def only_writer(file: Path) -> Iterator[None]:
    """Context with the lock on `file`, which the kernel releases if the process is killed.

    Raises InputError if another process is writing `file`. Prints a warning if the file system has no locks. A process
    that is forked in this context does not inherit the lock, and leaves it alone when it leaves the context.
    """
    lock, owner = lock_of(file), os.getpid()
    for _ in range(MOST_TRIES):
        with _open_lock(lock, os.O_RDWR | os.O_CREAT) as handle:
            try:
                lock_file(handle.fileno())
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise busy_error(file) from None
                _tell_no_locks(file)
            if not _is_file(handle, lock):  # its previous holder has deleted the lock file in between
                continue
            _HELD.append(handle)
            try:
                yield
            finally:
                if os.getpid() == owner:
                    _HELD.remove(handle)
                    lock.unlink(missing_ok=True)
            return
    raise busy_error(file)


def _close_inherited_locks() -> None:
    """Close the lock files in a forked process, which could outlive the writer and would keep them locked."""
    while _HELD:
        _HELD.pop().close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_inherited_locks)
_HELD: list[IO[str]] = []  # the lock files that this process has locked
MOST_TRIES = 100
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # errors on file systems without locks, as on some clusters


@functools.cache
def _tell_no_locks(file: Path) -> None:
    notice(f"{file} is on a file system without locks: two processes could write it, and one result would be lost")


def _open_lock(lock: Path, flags: int) -> IO[str]:
    """Open a lock file; its content is not used. Raises InputError for a link, which may lead anywhere."""
    try:
        return open(os.open(lock, flags | open_flags("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK"), 0o666))
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise InputError(f"{lock} is a link: delete it, or choose another name") from None


def _is_file(handle: IO[str], path: Path) -> bool:
    """Return True if `path` is still the name of an open file."""
    try:
        return os.fstat(handle.fileno()).st_ino == path.stat().st_ino
    except FileNotFoundError:
        return False


def require_owner(owner: int) -> None:
    """Raise InputError in a copy, made by os.fork, of the process `owner`, which alone carries on its run."""
    if os.getpid() != owner:
        raise InputError(
            f"this process is a copy of process {owner}, which carries on the run (os.fork in a progress function or a "
            "statistic): end the copy with os._exit"
        )


def signal_caught() -> int:
    """Return the number of the signal that stop_on_signals has noted in this process, or 0."""
    return _CAUGHT[0].caught if _CAUGHT else 0


def busy_error(file: Path) -> InputError:
    """Return the error for a file that another process is writing."""
    return InputError(f"{file} is being written by another process: wait for it, or choose another name")


def lock_of(file: Path) -> Path:
    """Return the path of the lock file of `file`."""
    return file.with_name(f".{file.name}.lock")


def is_being_written(file: Path) -> bool:
    """Return True if a process is currently writing `file`."""
    try:
        with _open_lock(lock_of(file), os.O_RDONLY) as handle:
            lock_file(handle.fileno(), shared=True)
    except FileNotFoundError:
        return False
    except OSError as error:
        return error.errno not in NO_LOCKS
    return False
