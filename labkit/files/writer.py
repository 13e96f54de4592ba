"""Writes a file in a separate thread while the program computes, and limits how often it does so."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

LEAST_PAUSE = 5.0  # least time (s) between the starts of two writes
SHARE = 0.05  # largest fraction of the time spent on writing


class Writer:
    """Runs one function at a time in a separate thread."""

    def __init__(self) -> None:
        """Create a writer; no thread is started yet."""
        self._executor = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None
        self._started, self._took = -LEAST_PAUSE, 0.0  # start and duration (s) of the last write

    def start(self, write: Callable[[], None]) -> None:
        """Start running a function; the previous one must have ended (`wait`)."""
        self._started = time.monotonic()
        self._running = self._executor.submit(self._write_and_time, write)

    def is_due(self) -> bool:
        """Return True if a write should start now: none is running, and the last write is long enough ago."""
        if self._running is not None and not self._running.done():
            return False
        return not 0.0 <= time.monotonic() - self._started < max(LEAST_PAUSE, self._took / SHARE)  # or clock set back

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
