"""Prepares plain Python functions, together with their callees, for Numba in double or single precision.

All callees are inlined, so that LLVM can vectorise the loop around them. Numba is imported only here and in
labkit.engines.kernel.machine, and only if something must be compiled.
"""

from __future__ import annotations

import functools
import importlib
import operator
import re
import types
import warnings
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np

from labkit.engines.kernel import scalars
from labkit.engines.kernel.frozen import Function, callees, describe, names_of
from labkit.errors import InputError
from labkit.extensions import is_labkits
from labkit.grains.laws import vectors
from labkit.once import once
from labkit.process.interruption import delay_interrupts

Untyped: TypeAlias = Any  # an object of Numba, or a value of any type that Numba passes on

# contract allows a*b + c in one instruction; other relaxations would not preserve NaN and the order of sums
OPTIONS: dict[str, Untyped] = {"error_model": "numpy", "fastmath": {"contract"}}
INLINE = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **OPTIONS}


@once
def load_numba() -> Untyped:
    """Import Numba, protected from Ctrl-C, and teach it the operators of vectors."""
    with delay_interrupts(), warnings.catch_warnings(record=True) as said:
        numba = importlib.import_module("numba")
        _require_settings(numba, said)
        importlib.import_module("numba.extending")
        vector = vectors.Vector
        sums = [(operation, meaning, vector, vector) for operation, meaning in vectors.SUMS]
        products = (operator.mul, vectors.product, float, vector), (operator.neg, vectors.opposite, vector)
        teach_operators(numba, [*sums, *products], INLINE)
    return numba


def _require_settings(numba: Untyped, said: Iterable[warnings.WarningMessage]) -> None:
    """Raise InputError if Numba cannot compile with the environment; `said` are the warnings of its import."""
    if numba.config.DISABLE_JIT:
        raise InputError("the environment variable NUMBA_DISABLE_JIT is 1 and the kernel is not compiled yet: unset it")
    for each in said:
        if unreadable := re.match(r"Environment variable '(\w+)' .* value '(.*)' could not be", str(each.message)):
            raise InputError(
                f"the environment variable {unreadable[1]} is {unreadable[2]!r}: give a number, or unset it"
            )


def inline(function: Function) -> Function:
    """Mark a function to be inlined wherever compiled code calls it; the indices in a user's function are checked."""
    return load_numba().njit(**INLINE, boundscheck=not is_labkits(function))(function)


def teach_operators(numba: Untyped, operators: Iterable[tuple[Any, ...]], options: dict[str, Untyped]) -> None:
    """Teach Numba operators of named tuples.

    Args:
        numba: Numba.
        operators: Operation, function that implements it, and the types of its arguments; float stands for any number.
        options: Options with which the functions are compiled.
    """
    kinds = numba.types

    def fits(kind: Untyped, wanted: type) -> bool:
        if wanted is float:
            return isinstance(kind, kinds.Number)
        return isinstance(kind, kinds.BaseNamedTuple) and kind.instance_class is wanted

    def teach(operation: Function, meaning: Function, *wanted: type) -> None:
        @functools.wraps(meaning)  # because Numba compares the signatures
        def implementation(*arguments: Untyped) -> Function | None:
            return meaning if all(map(fits, arguments, wanted)) else None

        numba.extending.overload(operation, jit_options=options)(implementation)

    for implemented in operators:
        teach(*implemented)


class Translation:
    """Functions in one precision, each prepared once; `translation` returns the Translation of this process.

    Args:
        single: True for single precision: constants in the functions are rounded, because a single double number would
            make Numba convert the whole expression to double.
    """

    def __init__(self, single: bool = False) -> None:
        """Start without prepared functions."""
        self.single = single
        self._known: dict[tuple[Function, str], Function] = {}
        self._instead: dict[Function, Function] = {vectors.choose: vectors.choose_number}
        if single:
            self._instead[vectors.inverse_root] = vectors.inverse_root_single

    def inline(self, function: Function, names: dict[str, Untyped] | None = None) -> Function:
        """Return a plain Python function prepared for Numba, with the plain Python functions that it calls.

        Args:
            function: Function in plain Python.
            names: New values of some names that the function uses.
        """
        if names is None:
            function = self._instead.get(function, function)
            key = function, describe(function).text  # a value that it uses may have changed, as in a notebook
            if key not in self._known:
                self._known[key] = self.inline(function, {})
            return self._known[key]
        called = {name: self.inline(value) for name, value in callees(function).items() if name not in names}
        return inline(with_names(function, numpy_for_numbers(function) | called | names, self.single))


translation = once(Translation)  # functions with several callers are compiled once


def with_names(function: Function, names: dict[str, Untyped], single: bool = False) -> Function:
    """Return a copy of a function with some names redefined and, if `single`, constants in single precision."""
    code, used = function.__code__, names_of(function)
    values = {name: to_single(value, single) for name, value in used.items()} | names
    if single:
        code = code.replace(co_consts=tuple(to_single(value) for value in code.co_consts))
    return types.FunctionType(
        code,
        {**function.__globals__, **values},
        function.__name__,
        to_single(function.__defaults__, single),
        tuple(types.CellType(values[name]) for name in code.co_freevars),
    )


def numpy_for_numbers(function: Function) -> dict[str, object]:
    """Return a new value of the name `np` if a function calls a function of `scalars`, otherwise an empty dict."""
    return {"np": scalars} if {"maximum", "minimum", "sqrt"} & set(function.__code__.co_names) else {}


def to_single(value: Untyped, single: bool = True) -> Untyped:
    """Round a float, or the floats in a tuple, to single precision; other values are returned as they are."""
    if single and isinstance(value, tuple):
        return type(value)(*map(to_single, value)) if hasattr(value, "_fields") else tuple(map(to_single, value))
    return np.float32(value) if single and isinstance(value, float) else value
