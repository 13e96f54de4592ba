"""Functions that take turns: each runs in its own thread, and only one thread runs at any time.

A run is a loop that calls an engine and waits for it. So that many runs can share one device without a change to that
loop, each has a thread, which gives up its turn whenever it needs the device.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class Turn:
    """A function in a thread of its own, and what it waits for.

    wanted: the argument of the last `ask`; None once the function has ended; failure: the exception that ended it.
    """

    def __init__(self, function: Callable[[Turn], None]) -> None:
        """Does not start the function yet; it gets this object as its argument."""
        self.wanted: Any = None
        self.failure: Exception | None = None
        self._function = function
        self._go, self._back = threading.Semaphore(0), threading.Semaphore(0)
        self._answer: Any = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def proceed(self, answer: Any = None, error: BaseException | None = None) -> None:
        """Let the function run until it asks for something or ends; what it asked for last is answered, or raises."""
        self._answer, self._error = answer, error
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._go.release()
        self._back.acquire()

    @property
    def ended(self) -> bool:
        """True if the function has ended."""
        return self._thread.ident is not None and self.wanted is None

    def ask(self, wanted: Any) -> Any:
        """Called by the function: give up the turn until `wanted` is answered. Raises what `proceed` is given."""
        self.wanted = wanted
        self._back.release()
        self._go.acquire()
        if self._error is not None:
            raise self._error
        return self._answer

    def _run(self) -> None:
        try:
            self._function(self)
        except Exception as error:
            self.failure = error
        finally:
            self.wanted = None
            self._back.release()
