"""Compilation with Numba: the options of the kernel, and a cache on disk that detects every change of the sources.

Numba caches one file per function and checks only the age of the file that defines this function, so a change in
another source file would leave stale code in use. Here the stamp of a cached function covers all its sources.
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

CONFIG: Any = numba.config  # sets its attributes at run time, where type checkers cannot see them

if CONFIG.CPU_FEATURES is None:  # by default LLVM uses half the width of the widest vectors of a processor
    CONFIG.CPU_FEATURES = llvmlite.binding.get_host_cpu_features().flatten() + ",-prefer-256-bit"

# A time step has two parallel loops of a few tenths of a millisecond. Threads of OpenMP spin while they wait for the
# next loop; those of the other layers sleep and wake too slowly. For busy cores see labkit.engines.threads.
CONFIG.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]

# contract: a*b + c in one instruction; no other relaxation, so that NaN and the order of sums are preserved
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


def stamp_of(files: Iterable[Path]) -> str:
    """Hash the contents of source files."""
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in sorted(files))).hexdigest()


KERNEL = stamp_of(Path(__file__).parent.glob("*.py"))


def compiled(function: Callable[..., Any]) -> Any:
    """Compile with Numba and the options of the kernel; a decorator."""
    return numba.njit(**OPTIONS)(function)


def kept(function: Callable[..., Any]) -> Any:
    """Compile with the same options and cache the result on disk.

    A decorator for functions of this package that Python code calls.
    """
    return cached(function, KERNEL, **OPTIONS)


def cached(function: Callable[..., Any], stamp: str | None, **options: Any) -> Any:
    """Return the function compiled at its first call, or read from disk if it was compiled from sources of this stamp.

    Without a stamp it is recompiled in each process.
    """
    dispatcher: Any = numba.njit(function, **options)
    if stamp is None:
        return dispatcher
    try:
        dispatcher.enable_caching()
    except RuntimeError:  # no writable folder
        return numba.njit(function, **options)
    file: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if not hasattr(file, "_source_stamp"):  # a private name of Numba, which another version may lack
        return numba.njit(function, **options)
    file._source_stamp = stamp, 0
    return dispatcher


def compiled_with_callees(function: Callable[..., Any], known: dict[Any, Any]) -> Any:
    """Compile a plain Python function together with the plain Python functions that it calls.

    All are inlined, so that LLVM can vectorise the loop around them. `known`: functions compiled so far, function ->
    compiled; extended in place.
    """
    if function not in known:
        names = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        callees = {
            name: compiled_with_callees(value, known) for name, value in names.items() if inspect.isfunction(value)
        }
        known[function] = numba.njit(forceinline=True, **OPTIONS)(with_globals(function, callees))
    return known[function]


def with_globals(function: Callable[..., Any], names: dict[str, Any]) -> Callable[..., Any]:
    """Return a copy of a function with some of its global names redefined.

    The copy belongs to this module, because Numba's cache imports the module of every compiled function, and a contact
    law may come from a file that another process cannot import.
    """
    values = {**function.__globals__, **names, "__name__": __name__}
    fresh = types.FunctionType(function.__code__, values, function.__name__, function.__defaults__)
    fresh.__qualname__ = function.__qualname__
    return fresh
