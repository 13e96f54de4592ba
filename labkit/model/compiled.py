"""Compiles the model to machine code: C functions of pointers and numbers, compiled from plain Python for each law.

The functions of this package are plain Python. `entry` marks the few functions that Python calls often. Such an entry
turns pointers into arrays (`numbers_at`) and constants (`constants_at`) and computes with them. It is compiled, with
all functions that it calls, when a law first needs it. labkit.engines.kernel.machine stores the entries of labkit's
laws, so that later processes need not import Numba. Compiled code cannot allocate memory: callers pass work arrays.
"""

from __future__ import annotations

import ctypes
import functools
import operator
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from labkit.engines.kernel import frozen, machine, object_code, translate
from labkit.engines.kernel.frozen import Function, callees
from labkit.engines.kernel.machine import address_of, hash_files
from labkit.engines.kernel.translate import Untyped, load_numba, teach_operators, with_names
from labkit.extensions import is_labkits
from labkit.model.tensors import Six, add, multiply, subtract
from labkit.once import LOCK, once
from labkit.sff import c0

Pointer: TypeAlias = Any  # a pointer to doubles
Constants: TypeAlias = Any  # a named tuple with the constants of a law
Table: TypeAlias = Any  # a pointer to an array of Pointers (labkit.engines.kernel.tables.Pointers)

ELSEWHERE = (c0, frozen, machine, object_code, translate)  # modules outside this package that code depends on
SOURCES = {*Path(__file__).parent.rglob("*.py"), *(Path(str(module.__file__)) for module in ELSEWHERE)}
OPTIONS: dict[str, Untyped] = {"error_model": "numpy"}
CALLEE = {**OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
KINDS = {"Pointer": ctypes.c_void_p, "Table": ctypes.c_void_p, "int": ctypes.c_int64, "float": ctypes.c_double}

_INSTEAD: dict[Function, Callable[[type], Function]] = {}
_INLINE: set[Function] = set()
REPORTS = threading.Lock()  # held while a function of a user's law may report an exception


def instead(write: Callable[[type], Function]) -> Callable[[Function], Function]:
    """Return a decorator that replaces a function in compiled code by `write(kind)`; `kind`: type of the constants."""

    def decorate(function: Function) -> Function:
        _INSTEAD[function] = write
        return function

    return decorate


def always_inline(function: Function) -> Function:
    """Mark a function to be inlined in compiled code; meant for a function that only one loop calls."""
    _INLINE.add(function)
    return function


def address(array: Any) -> int:
    """Return the address of the data of a contiguous array, 0 if it is empty; the array must outlive the address."""
    if array.size and array.flags.writeable:
        return ctypes.addressof(ctypes.c_char.from_buffer(array))  # six times faster than ndarray.ctypes
    return int(array.ctypes.data) if array.size else 0


def numbers_at(pointer: Pointer, shape: int | tuple[int, ...]) -> np.ndarray:
    """Return the array at a pointer; works only in compiled code."""
    raise NotImplementedError


@instead(lambda kind: _unpack(kind))
def constants_at(pointer: Pointer) -> Constants:
    """Return the constants of the law from the numbers at a pointer; works only in compiled code."""
    raise NotImplementedError


def _unpack(kind: type[Any]) -> Function:
    flags = {name for name, kind_of_field in getattr(kind, "__annotations__", {}).items() if kind_of_field == "bool"}
    values = ", ".join(f"x[{k}]" + (" != 0.0" if name in flags else "") for k, name in enumerate(kind._fields))
    names: dict[str, Function] = {"kind": kind, "numbers_at": numbers_at}
    exec(f"def unpack(pointer):\n    x = numbers_at(pointer, {len(kind._fields)})\n    return kind({values})\n", names)
    return names["unpack"]


class CompiledEntry:
    """A function that Python calls; its arguments are annotated Pointer, Table, int or float, and it returns an int."""

    def __init__(self, function: Function) -> None:
        """Store the function; it is compiled on first use."""
        self._function = function
        self._kinds = [annotation for name, annotation in function.__annotations__.items() if name != "return"]
        self._compiled: dict[type, Callable[..., int]] = {}

    def of(self, kind: type) -> Callable[..., int]:
        """Return the compiled function for a type of constants, a key of labkit.model.law.FUNCTIONS."""
        if kind not in self._compiled:
            with LOCK:
                if kind not in self._compiled:
                    self._compiled[kind] = self._find(kind)
        return self._compiled[kind]

    def stamp(self, kind: type) -> str:
        """Return the name of the machine code for one of labkit's laws, which changes with every source."""
        file = Path(self._function.__code__.co_filename)  # perhaps in a plug-in
        return f"{_hash_with(file)} {self._function.__name__.strip('_')} {kind.__module__}.{kind.__qualname__}"

    def _find(self, kind: type) -> Callable[..., int]:
        prototype = ctypes.CFUNCTYPE(ctypes.c_int64, *(KINDS[name] for name in self._kinds))
        if is_labkits(kind):
            name = self._function.__name__.strip("_")
            return prototype(address_of(name, functools.partial(self._write, kind), self.stamp(kind), OPTIONS))
        function, signature = self._write(kind)
        compiled = _numba().cfunc(signature, **OPTIONS)(function)
        return _raise_errors_of(prototype(compiled.address), compiled)

    def _write(self, kind: type) -> tuple[Function, Untyped]:
        types = _numba().types
        kinds = {"Pointer": types.voidptr, "int": types.int64, "float": types.float64}
        kinds["Table"] = types.CPointer(types.voidptr)
        function = _with_callees(self._function, kind, _functions_for(kind))
        return function, types.int64(*(kinds[name] for name in self._kinds))


def entry(function: Function) -> CompiledEntry:
    """Mark a function that Python calls; it is compiled on first use."""
    return CompiledEntry(function)


@functools.cache
def _hash_with(file: Path) -> str:
    return hash_files(SOURCES | {file})


@once
def _numba() -> Untyped:
    """Import Numba, and teach it the operators of Six tensors."""
    numba = load_numba()
    sums = (operator.add, add, Six, Six), (operator.sub, subtract, Six, Six)
    teach_operators(numba, [*sums, (operator.mul, multiply, float, Six)], CALLEE)
    return numba


@once
def _functions_for(kind: type) -> dict[Function, Function]:
    """Return the functions prepared so far for a type of constants; all entries share them."""
    numba = _numba()
    carray = numba.carray
    return {numbers_at: numba.njit(**CALLEE)(lambda pointer, shape: carray(pointer, shape, np.float64))}


def _with_callees(function: Function, kind: type, prepared: dict[Function, Function]) -> Function:
    """Return a function in which the functions that it calls are replaced by versions prepared for Numba."""
    names = {name: _prepare(value, kind, prepared) for name, value in callees(function).items()}
    return with_names(function, names)


def _prepare(function: Function, kind: type, prepared: dict[Function, Function]) -> Function:
    if function not in prepared:
        meant = _INSTEAD[function](kind) if function in _INSTEAD else function
        options = {**CALLEE, "forceinline": function in _INLINE, "boundscheck": not is_labkits(meant)}
        prepared[function] = _numba().njit(**options)(_with_callees(meant, kind, prepared))
    return prepared[function]


def _raise_errors_of(function: Callable[..., int], compiled: Untyped) -> Callable[..., int]:
    """Wrap a function compiled for a user's law so that it raises the exceptions that Numba only reports.

    Only one thread at a time can take the reports, so such a law computes in one thread at a time.
    """

    def call(*arguments: float) -> int:
        reported: list[BaseException | None] = []
        with REPORTS:
            before, sys.unraisablehook = sys.unraisablehook, lambda event: reported.append(event.exc_value)
            try:
                status = function(*arguments)
            finally:
                sys.unraisablehook = before
        for error in reported:
            raise error or RuntimeError(f"{compiled.native_name} failed")
        return status

    return call
