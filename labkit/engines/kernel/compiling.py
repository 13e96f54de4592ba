"""Compiles with Numba, using the options of the kernel and a cache on disk that detects every change of the sources.

Numba caches one file per function and checks only the age of the file that defines this function, so a change in
another source file would leave stale code in use. Here the stamp of a cached function covers all its sources.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import importlib
import inspect
import operator
import os
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np
from numba.extending import overload

from labkit.engines.kernel import scalars
from labkit.grains.laws import vectors
from labkit.io.caches import cache_folder, private_folder
from labkit.servo import formula

Untyped: TypeAlias = Any  # an object of Numba, or a value of any type that Numba passes on
Function: TypeAlias = Callable[..., Any]  # a function for Numba, compiled or not
Plain = TypeVar("Plain", bound=Function)

CONFIG: Untyped = numba.config  # sets its attributes at run time, where type checkers cannot see them


def without_blas() -> None:
    """Let Numba load its functions without SciPy's linear algebra, which the kernels do not use.

    This saves 0.15 s at the start of each command. Compiled functions that do use it import it when they are called.
    """
    linalg: Untyped = importlib.import_module("numba.np.linalg")
    check = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    importlib.import_module("numba.np.arraymath")
    linalg.ensure_blas = check


with contextlib.suppress(ImportError, AttributeError):  # private names of Numba, which another version may lack
    without_blas()

if CONFIG.CPU_FEATURES is None:  # by default LLVM uses half the width of the widest vectors of a processor
    CONFIG.CPU_FEATURES = llvmlite.binding.get_host_cpu_features().flatten() + ",-prefer-256-bit"

# A time step has two parallel loops of a few tenths of a millisecond. Threads of OpenMP spin while they wait for the
# next loop; those of the other layers sleep and wake too slowly. For busy cores see labkit.engines.threads.
CONFIG.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]

# contract: a*b + c in one instruction; no other relaxation, so that NaN and the order of sums are preserved
OPTIONS: dict[str, Untyped] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "no_cfunc_wrapper": True,
}
CALLEE = {"no_cpython_wrapper": True, **OPTIONS}  # for functions that only compiled code calls
with contextlib.suppress(ImportError):
    CALLEE["pipeline_class"] = importlib.import_module("labkit.engines.kernel.callees").CalleeCompiler
INLINE = {"forceinline": True, **CALLEE}


def stamp_of(files: Iterable[Path]) -> str:
    """Hash the contents of source files."""
    return hashlib.sha256(b"".join(Path(file).read_bytes() for file in sorted(files))).hexdigest()


KERNEL = stamp_of([*Path(__file__).parent.glob("*.py"), Path(vectors.__file__), Path(formula.__file__)])


def compile_callee(function: Plain) -> Plain:
    """Compile with Numba and the options of the kernel.

    A decorator for functions that only compiled code calls.
    """
    return cast(Plain, numba.njit(**CALLEE)(function))


def compile_and_keep(function: Plain) -> Plain:
    """Compile with the same options and cache the result on disk.

    A decorator for functions of this package that Python code calls.
    """
    return cast(Plain, cache_on_disk(function, KERNEL, **OPTIONS))


def cache_on_disk(function: Function, stamp: str | None, **options: Untyped) -> Function:
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


@functools.cache
def compiled_folder() -> Path | None:
    """Return the folder of compiled code, which nobody but this user can change, or None.

    Numba's index of a compiled function is a pickle, and both are executed when they are loaded.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if not given:
        return cache_folder("compiled")
    folder = private_folder(Path(given))
    return folder and private_folder(folder / "labkit")


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


def _forgiving(use: Function, nothing: Callable[[], Untyped]) -> Function:
    """Wrap a use of the cache: a file that a full disk or a power failure has truncated counts as missing."""

    def used(*arguments: Untyped) -> Untyped:
        try:
            return use(*arguments)
        except Exception:  # pickle may raise any exception
            return nothing()

    return used


def _alone(use: Function, folder: str) -> Function:
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


def use_operators() -> None:
    """Teach Numba the operators of vectors."""
    kinds: Untyped = numba.types
    options: Untyped = INLINE

    def is_vector(kind: Untyped) -> bool:
        return isinstance(kind, kinds.BaseNamedTuple) and kind.instance_class is vectors.Vector

    def is_number(kind: Untyped) -> bool:
        return isinstance(kind, kinds.Number)

    def teach(operation: Function, meaning: Function, *fits: Callable[[Untyped], bool]) -> None:
        @functools.wraps(meaning)  # Numba compares the signatures
        def implementation(*arguments: Untyped) -> Function | None:
            return meaning if all(fit(kind) for fit, kind in zip(fits, arguments, strict=True)) else None

        overload(operation, jit_options=options)(implementation)

    for operation, meaning in vectors.SUMS:
        teach(operation, meaning, is_vector, is_vector)
    teach(operator.mul, vectors.product, is_number, is_vector)
    teach(operator.neg, vectors.opposite, is_vector)


use_operators()


class Version(NamedTuple):
    """Version of a kernel: `name`, of its contact law and precision, and `single`, explained in `with_globals`."""

    name: str
    single: bool = False


def inline(function: Function) -> Function:
    """Compile a function that is inlined wherever compiled code calls it, and that Python cannot call."""
    return numba.njit(**INLINE)(function)


def compile_with_callees(
    function: Function,
    known: dict[Function, Function],
    version: Version,
    compiler: Callable[[Function], Function] = inline,
) -> Function:
    """Compile a plain Python function together with the plain Python functions that it calls.

    By default all are inlined, so that LLVM can vectorise the loop around them.

    Args:
        function: Function in plain Python.
        known: Functions compiled so far, function -> compiled; extended in place.
        version: Version of the kernel to which they belong.
        compiler: Compiles one function.
    """
    if function not in known:
        known[function] = compiler(with_globals(function, callees(function, known, version, compiler), version))
    return known[function]


def callees(
    function: Function, known: dict[Function, Function], version: Version, compiler: Callable[[Function], Function]
) -> dict[str, object]:
    """Return new values for names in a function: the plain Python functions it calls, compiled, and np for numbers."""
    used = {name: value for name, value in names_of(function).items() if inspect.isfunction(value)}
    compiled = {name: compile_with_callees(value, known, version, compiler) for name, value in used.items()}
    return numpy_for_numbers(function) | compiled


def numpy_for_numbers(function: Function) -> dict[str, object]:
    """Return a new value for the name np if a function calls one of `scalars`, otherwise nothing."""
    return {"np": scalars} if {"maximum", "minimum", "sqrt"} & set(function.__code__.co_names) else {}


def names_of(function: Function) -> dict[str, object]:
    """Return the values of the global and enclosing variables that a function uses.

    Globals that share the name of an attribute in the function are among them; none of labkit's functions has one.
    """
    code, known = function.__code__, function.__globals__
    enclosed = zip(code.co_freevars, function.__closure__ or (), strict=True)
    used = {name: known[name] for name in code.co_names if name in known}
    return used | {name: cell.cell_contents for name, cell in enclosed}


def with_globals(function: Function, names: dict[str, Untyped], version: Version) -> Function:
    """Return a copy of a function with some of its names redefined, and named after the version of its kernel.

    The name matters: kernels that different processes wrote to the cache may contain functions with equal symbols,
    which Numba makes from names and argument types. LLVM would then link one kernel to functions of another.

    If version.single is True, the numbers written in the function are rounded to single precision, because Numba would
    convert an expression in which one number is double. The copy belongs to this module, because Numba's cache imports
    the module of every compiled function, and a contact law may come from a file that another process cannot import.
    """
    code, used = function.__code__, names_of(function)
    values = {name: to_single(value, version.single) for name, value in used.items()} | names
    if version.single:
        code = code.replace(co_consts=tuple(to_single(value) for value in code.co_consts))
    fresh = types.FunctionType(
        code,
        {**function.__globals__, **values, "__name__": __name__},
        function.__name__,
        to_single(function.__defaults__, version.single),
        tuple(types.CellType(values[name]) for name in code.co_freevars),
    )
    fresh.__qualname__ = f"{function.__qualname__}_{version.name}"
    return fresh


def to_single(value: Untyped, single: bool = True) -> Untyped:
    """Round a float, or the floats in a tuple, to single precision; other values are returned as they are."""
    if single and isinstance(value, tuple):
        return type(value)(*map(to_single, value)) if hasattr(value, "_fields") else tuple(map(to_single, value))
    return np.float32(value) if single and isinstance(value, float) else value
