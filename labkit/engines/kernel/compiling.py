"""How labkit compiles with Numba: the options of the kernel, and a cache on disk that notices every change.

Numba keeps one file per function and looks at the age of that function's own file only, so that a change in
another file would leave stale code behind. Here the stamp of a cached function is that of all its sources.
"""

from __future__ import annotations

import hashlib
import inspect
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

if numba.config.CPU_FEATURES is None:  # left to itself, LLVM would use half of a processor's widest vectors
    numba.config.CPU_FEATURES = llvmlite.binding.get_host_cpu_features().flatten() + ",-prefer-256-bit"

# A step has two loops of a few tenths of a millisecond: OpenMP's threads wait for the next one awake, the others' would
# sleep. On a computer without a free core that helps nobody: one thread is the fastest there.
numba.config.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]

# contract: a*b + c in one instruction. Nothing that would let NaN or the order of sums go unnoticed.
OPTIONS = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


def stamp_of(files: Iterable[Path]) -> str:
    """A hash of the text of source files."""
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in sorted(files))).hexdigest()


ROOM = stamp_of(Path(__file__).parent.glob("*.py"))


def compiled(function: Callable[..., Any]) -> Any:
    """Numba's decorator as the whole kernel uses it."""
    return numba.njit(**OPTIONS)(function)


def kept(function: Callable[..., Any]) -> Any:
    """The same, kept on disk: for functions of this room that Python calls."""
    return cached(function, ROOM, **OPTIONS)


def cached(function: Callable[..., Any], stamp: str | None, **options: Any) -> Any:
    """The function compiled at its first call, or read from the disk if it was compiled from sources of this stamp.

    Without a stamp it is compiled anew in each process.
    """
    dispatcher = numba.njit(function, **options)
    if stamp is None:
        return dispatcher
    try:
        dispatcher.enable_caching()
        dispatcher._cache._cache_file._source_stamp  # Numba's own name for it: without it no file is kept
    except (RuntimeError, AttributeError):  # nowhere to write, or another Numba
        return numba.njit(function, **options)
    dispatcher._cache._cache_file._source_stamp = stamp, 0
    return dispatcher


def compiled_with_callees(function: Callable[..., Any], known: dict[Any, Any]) -> Any:
    """A plain Python function compiled together with the plain Python functions that it calls.

    They are inlined, so that the loop around them can be turned into vector instructions. `known`: what is compiled
    already, function -> compiled; grows.
    """
    if function not in known:
        names = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        callees = {
            name: compiled_with_callees(value, known) for name, value in names.items() if inspect.isfunction(value)
        }
        known[function] = numba.njit(forceinline=True, **OPTIONS)(with_globals(function, callees))
    return known[function]


def with_globals(function: Callable[..., Any], names: dict[str, Any]) -> Callable[..., Any]:
    """The same function with some of its global names meaning something else.

    It counts as one of this module: Numba's cache imports the module of every function that it has compiled, and a
    contact law may come from a file that is no module in another process.
    """
    known = {**function.__globals__, **names, "__name__": __name__}
    fresh = types.FunctionType(function.__code__, known, function.__name__, function.__defaults__)
    fresh.__qualname__ = function.__qualname__
    return fresh
