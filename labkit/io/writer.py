"""A thread that writes a file while the program computes, and decides how often that is worthwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

LEAST_PAUSE = 5.0  # s between the starts of two writes
SHARE = 0.05  # largest share of the time spent on writing


class Writer:
    """Runs one function at a time in a separate thread."""

    def __init__(self) -> None:
        """Start no thread yet."""
        self._executor = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None
        self._started, self._took = -LEAST_PAUSE, 0.0  # duration of the last write, s

    def start(self, write: Callable[[], None]) -> None:
        """Start running a function; the previous one must have ended (`wait`)."""
        self._started = time.monotonic()
        self._running = self._executor.submit(self._write_and_time, write)

    def is_due(self) -> bool:
        """True if a write should start now: none is running, and the pause since the last one was long enough."""
        if self._running is not None and not self._running.done():
            return False
        return time.monotonic() - self._started >= max(LEAST_PAUSE, self._took / SHARE)

    def wait(self) -> None:
        """Wait for the running function. Raises the exception with which it ended."""
        running, self._running = self._running, None
        if running is not None:
            running.result()

    def close(self) -> None:
        """Wait for the running function and end the thread. Raises the exception that ended the function."""
        try:
            self.wait()
        finally:
            self._executor.shutdown()

    def _write_and_time(self, write: Callable[[], None]) -> None:
        write()
        self._took = time.monotonic() - self._started
