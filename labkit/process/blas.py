"""Restricts NumPy's linear algebra to one thread while a task runs.

OpenBLAS divides products of long arrays among all cores. The sums in a record would then depend on the number of cores,
and on a busy computer the threads wait for each other ten times as long as a single thread needs to compute.
"""

from __future__ import annotations

import contextlib
import ctypes
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

NAMES = ("scipy_openblas_{}_num_threads64_", "scipy_openblas_{}_num_threads", "openblas_{}_num_threads")


_LOCK = threading.Lock()
_restore = contextlib.ExitStack()  # closed by the last task that ends
_tasks = 0  # tasks now running, in any thread


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which OpenBLAS uses one thread; if several threads enter it, until the last of them leaves.

    The context has no effect on other BLAS libraries.
    """
    global _tasks
    with _LOCK:
        if _tasks == 0:
            for count, change in thread_switches():
                _restore.callback(change, count())
                change(1)
        _tasks += 1
    try:
        yield
    finally:
        with _LOCK:
            _tasks -= 1
            if _tasks == 0:
                _restore.close()


def thread_switches() -> Iterator[tuple[Callable[[], int], Callable[[int], object]]]:
    """Yield, for each OpenBLAS in this process, the functions that return and set its number of threads."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:  # not Linux
        return
    for file in sorted({line.split(maxsplit=5)[-1] for line in lines if "openblas" in line}):
        library = ctypes.CDLL(file)
        for name in NAMES:
            if hasattr(library, name.format("set")):
                yield getattr(library, name.format("get")), getattr(library, name.format("set"))
                break
