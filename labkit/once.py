"""Results that a process computes once, even if several threads need them at the same time."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Hashable
from typing import TypeVar, cast

Compute = TypeVar("Compute", bound=Callable[..., object])

LOCK = threading.RLock()  # held while a result is computed, and while machine code is compiled and loaded
if hasattr(os, "register_at_fork"):  # otherwise a child could wait forever for a lock that a thread of its parent held
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)


def once(function: Compute) -> Compute:
    """Return a function that computes the result for each set of arguments once; other threads wait for the result.

    Unlike functools.cache, it never returns two objects for the same arguments.
    """
    results: dict[tuple[Hashable, ...], object] = {}

    @functools.wraps(function)
    def result(*arguments: Hashable) -> object:
        if arguments not in results:
            with LOCK:
                if arguments not in results:
                    results[arguments] = function(*arguments)
        return results[arguments]

    return cast(Compute, result)
