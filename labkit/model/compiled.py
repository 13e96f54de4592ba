"""The decorator `@jit`: Numba in nopython mode, with a cache on disk that is shared between processes.

The stamp of every function covers all files of this package and C0, which is compiled too: a change in any of these
files invalidates the cached code. Numba alone checks only the age of the file that defines a function.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numba
from numba.core.registry import CPUDispatcher

from labkit.engines.kernel.machine import compiled_folder, hash_files
from labkit.sff import c0

Untyped: TypeAlias = Any  # an object of Numba
Compilable: TypeAlias = Callable[..., Any]
CONFIG: Untyped = numba.config

CALLEE: dict[str, Untyped] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "nogil": True,
    "error_model": "numpy",
}
with contextlib.suppress(ImportError):
    CALLEE["pipeline_class"] = importlib.import_module("labkit.model.callees").CalleeCompiler


_STAMP = hash_files([*Path(__file__).parent.rglob("*.py"), Path(c0.__file__)])


class Function(CPUDispatcher):
    """A compiled function whose `callee` stands for it in compiled code, without machine code of its own.

    Numba would otherwise optimise every function that another one calls, and then both of them once more.
    """

    callee: Any

    @property
    def _numba_type_(self) -> Any:
        return numba.types.Dispatcher(self.callee)


def jit(function: Callable[..., object]) -> Any:
    """Return the function, compiled at its first call or loaded from the cache on disk."""
    dispatcher: Any = cache_on_disk(function, _STAMP, error_model="numpy", nogil=True)
    file = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    for name in ("load", "save") if file else ():
        setattr(file, name, _of_labkits_laws(getattr(file, name)))
    dispatcher.__class__, dispatcher.callee = Function, numba.njit(function, **CALLEE)
    return dispatcher


def _of_labkits_laws(use: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a use of the cache to leave out functions compiled for a user's law, whose file has no stamp."""

    def used(key: Any, *data: object) -> Any:
        kinds = [getattr(kind, "instance_class", kind) for kind in key[0]]
        labkits = all(kind.__module__.startswith(("labkit.", "numba.")) for kind in kinds)
        return use(key, *data) if labkits else None

    return used


def cache_on_disk(function: Compilable, stamp: str | None, **options: Untyped) -> Compilable:
    """Return a function that is compiled at its first call, or read from disk if compiled from sources of this stamp.

    Without a stamp it is recompiled in each process.
    """
    dispatcher: Untyped = numba.njit(function, **options)
    folder = compiled_folder()
    if stamp is None or folder is None:
        return dispatcher
    before, CONFIG.CACHE_DIR = CONFIG.CACHE_DIR, str(folder)
    try:
        dispatcher.enable_caching()
    except RuntimeError:  # no writable folder
        return numba.njit(function, **options)
    finally:
        CONFIG.CACHE_DIR = before
    file: Untyped = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    # private names of Numba, which another version may lack; where it cannot write it would choose another folder
    if not hasattr(file, "_source_stamp") or folder not in Path(getattr(file, "_cache_path", "")).parents:
        return numba.njit(function, **options)
    file._source_stamp = stamp, 0
    file._load_index = _forgiving(file._load_index, dict)
    for name in ("load", "save"):
        setattr(file, name, _forgiving(_alone(getattr(file, name), file._cache_path), type(None)))
    _compile_once(dispatcher, file)
    return dispatcher


def _compile_once(dispatcher: Untyped, file: Untyped) -> None:
    """Let one process at a time compile a function that the cache lacks; the others wait and read it.

    They cannot wait in a circle, because a process that compiles a function waits only for functions that it calls.
    """
    load, compile_, held = file.load, dispatcher.compile, []

    def load_or_wait(key: Untyped) -> Untyped:
        found = load(key)
        if found is None:
            with contextlib.suppress(OSError):  # a folder without write access, or a file system without locks
                held.append(os.open(f"{file._index_path}.lock", os.O_CREAT | os.O_RDWR))
                fcntl.flock(held[-1], fcntl.LOCK_EX)
                found = load(key)
        return found

    def compile_and_release(signature: Untyped) -> Untyped:
        try:
            return compile_(signature)
        finally:
            while held:
                os.close(held.pop())

    file.load, dispatcher.compile = load_or_wait, compile_and_release


def _forgiving(use: Compilable, nothing: Callable[[], Untyped]) -> Compilable:
    """Wrap a use of the cache: a file that a full disk or a power failure has truncated counts as missing."""

    def used(*arguments: Untyped) -> Untyped:
        try:
            return use(*arguments)
        except Exception:  # pickle may raise any exception
            return nothing()

    return used


def _alone(use: Compilable, folder: str) -> Compilable:
    """Wrap a use of the cache so that no other process interrupts it, if the file system has locks.

    Numba stores a function in file 1, 2 ... after reading an index of the numbers in use, and locks neither, so it
    might read the function of another process or of other sources instead.
    """

    def used(*arguments: Untyped) -> Untyped:
        place = os.open(folder, os.O_RDONLY)
        try:
            with contextlib.suppress(OSError):
                fcntl.flock(place, fcntl.LOCK_EX)
            return use(*arguments)
        finally:
            os.close(place)

    return used
