"""A thread that writes a netCDF file while the program computes, and decides how often that is worthwhile.

The netCDF library serves one thread at a time. Whoever starts a write therefore waits for it before opening a file. No
garbage is collected meanwhile: it may contain open files, and closing one of them would call the library.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from typing import ClassVar

LEAST_PAUSE = 5.0  # s between the starts of two writes
SHARE = 0.05  # of the time may be spent on writing


class Writer:
    """Runs one function at a time in a thread of its own, and only while no other Writer of the process does."""

    _latest: ClassVar[Future[None] | None] = None  # of any Writer

    def __init__(self) -> None:
        """Starts no thread yet."""
        self._executor = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None
        self._started, self._took = -LEAST_PAUSE, 0.0  # s, of the last write
        self._collects = gc.isenabled()

    def start(self, write: Callable[[], None]) -> None:
        """Start to run a function; the previous one must have ended (`wait`)."""
        self._wait_for_others()
        self._started = time.monotonic()
        self._collects = gc.isenabled()
        gc.disable()
        self._running = Writer._latest = self._executor.submit(self._timed, write)

    def is_due(self) -> bool:
        """True if a write should start now: none is running, and the pause since the last one was long enough."""
        if self._running is not None and not self._running.done():
            return False
        return time.monotonic() - self._started >= max(LEAST_PAUSE, self._took / SHARE)

    def wait(self) -> None:
        """Wait for the running function, of any Writer. Raises the exception with which that of this one ended."""
        self._wait_for_others()
        running, self._running = self._running, None
        if running is None:
            return
        try:
            running.result()
        finally:
            if self._collects:
                gc.enable()

    def _wait_for_others(self) -> None:
        if Writer._latest is not None and Writer._latest is not self._running:
            wait_for([Writer._latest])

    def close(self) -> None:
        """Wait for the running function and end the thread. Raises the exception with which the function ended."""
        try:
            self.wait()
        finally:
            self._executor.shutdown()

    def _timed(self, write: Callable[[], None]) -> None:
        write()
        self._took = time.monotonic() - self._started
