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
from typing import Any, NamedTuple

import llvmlite.binding
import numba
import numpy as np

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


class Version(NamedTuple):
    """Of a kernel. name: of its contact law and precision; single: see `with_globals`."""

    name: str
    single: bool = False


def compiled_with_callees(function: Callable[..., Any], known: dict[Any, Any], version: Version) -> Any:
    """Compile a plain Python function together with the plain Python functions that it calls.

    All are inlined, so that LLVM can vectorise the loop around them. `known`: functions compiled so far, function ->
    compiled; extended in place.
    """
    if function not in known:
        names = {name: function.__globals__.get(name) for name in function.__code__.co_names}
        callees = {
            name: compiled_with_callees(value, known, version)
            for name, value in names.items()
            if inspect.isfunction(value)
        }
        known[function] = numba.njit(forceinline=True, **OPTIONS)(with_globals(function, callees, version))
    return known[function]


def with_globals(function: Callable[..., Any], names: dict[str, Any], version: Version) -> Callable[..., Any]:
    """Return a copy of a function with some of its global names redefined, and named after the version of its kernel.

    The name matters: kernels that different processes wrote to the cache may contain functions with equal symbols,
    which Numba makes of names and argument types. LLVM would then link one kernel to functions of another.

    version.single: True to round the numbers written in the function to single precision, because Numba would convert
    an expression in which one number is double. The copy belongs to this module, because Numba's cache imports the
    module of every compiled function, and a contact law may come from a file that another process cannot import.
    """
    code = function.__code__
    values = {**function.__globals__, "__name__": __name__}
    if version.single:
        code = code.replace(co_consts=tuple(rounded(value) for value in code.co_consts))
        values |= {name: rounded(values[name]) for name in code.co_names if name in values}
    fresh = types.FunctionType(
        code, {**values, **names}, function.__name__, rounded(function.__defaults__, version.single)
    )
    fresh.__qualname__ = f"{function.__qualname__}_{version.name}"
    return fresh


def rounded(value: Any, single: bool = True) -> Any:
    """A float, or the floats in a tuple, in single precision; other values as they are."""
    if single and isinstance(value, tuple):
        return type(value)(*map(rounded, value)) if hasattr(value, "_fields") else tuple(map(rounded, value))
    return np.float32(value) if single and isinstance(value, float) else value
