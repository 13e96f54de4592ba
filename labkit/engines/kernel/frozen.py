"""Everything that Numba freezes when it compiles a function, as text.

Numba compiles a function with all functions that it calls, and turns the values of globals, enclosing variables,
defaults and numbers of modules into constants. Machine code may therefore be used again only while this text is the
same.
"""

from __future__ import annotations

import hashlib
import inspect
import types
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from labkit.extensions import is_labkits

Function: TypeAlias = Callable[..., Any]  # a function for Numba, compiled or not

PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...))
WITH_VERSION = ("builtins", "math", "operator", "numpy")  # modules whose functions and classes a name identifies


class Frozen(NamedTuple):
    """What Numba freezes.

    Args:
        text: The description; a value that it cannot describe appears as the address of an object in this process.
        complete: False if the text contains such a value, so that it means nothing in a later process.
    """

    text: str
    complete: bool


def describe(*functions: Function) -> Frozen:
    """Describe functions, the functions that they call, and all values that they use."""
    numbers = {function: number for number, function in enumerate(all_functions(*functions))}
    unknown: list[object] = []

    def text_of(value: Any, names: set[str]) -> str:
        """Describe a value; `names` are the names in the function that uses it, and perhaps attributes of a module."""
        kind = type(value)
        if inspect.isfunction(value) and value in numbers:
            return f"function {numbers[value]}"
        if kind in PLAIN:
            return f"{kind.__name__} {value!r}"
        if isinstance(value, (np.generic, np.ndarray)) and not value.dtype.hasobject:
            digest = hashlib.sha256(value.tobytes()).hexdigest()
            return f"{kind.__name__} {value.dtype.descr} {value.shape} {value.strides} {digest}"
        if isinstance(value, tuple):
            return f"{text_of(kind, names)} ({', '.join(text_of(item, names) for item in value)})"
        if isinstance(value, types.CodeType):
            return f"{value.co_code.hex()} {value.co_varnames} {value.co_names} {text_of(value.co_consts, names)}"
        if isinstance(value, types.ModuleType):
            attributes = sorted(names & vars(value).keys())
            return f"{value.__name__} {[(name, text_of(vars(value)[name], names)) for name in attributes]}"
        home = str(getattr(value, "__module__", None)).partition(".")[0]
        if home in WITH_VERSION and hasattr(value, "__qualname__"):
            return f"{value.__module__}.{value.__qualname__}"
        if isinstance(value, np.ufunc):
            return f"numpy.{value.__name__}"
        if inspect.isclass(value) and issubclass(value, tuple):
            return f"{value.__module__}.{value.__qualname__} {getattr(value, '_fields', ())}"
        unknown.append(value)
        return f"{kind.__module__}.{kind.__qualname__} at {id(value):#x}"

    lines = []
    for function in numbers:
        names = set(_names_in(function.__code__))
        labkits = is_labkits(function)  # its code follows from the hash of its file
        used = sorted(names_of(function).items()), function.__defaults__, function.__kwdefaults__
        code = () if labkits else function.__code__
        values = [(name, text_of(value, names)) for name, value in used[0]]
        lines.append(f"{function.__module__}.{function.__qualname__} {values} {text_of((*used[1:], code), names)}")
    return Frozen("\n".join(lines), not unknown)


def _names_in(code: types.CodeType) -> Iterator[str]:
    """Yield the names in a function, and in the functions and comprehensions inside it."""
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            yield from _names_in(inner)


def names_of(function: Function) -> dict[str, object]:
    """Return the values of the global and enclosing variables that a function uses.

    They include globals with the same name as an attribute in the function, which labkit's own functions do not have.
    """
    code, scope = function.__code__, function.__globals__
    enclosed = zip(code.co_freevars, function.__closure__ or (), strict=True)
    used = {name: scope[name] for name in _names_in(code) if name in scope}
    return used | {name: cell.cell_contents for name, cell in enclosed}


def callees(function: Function) -> dict[str, Function]:
    """Return the plain Python functions that a function names."""
    return {name: value for name, value in names_of(function).items() if inspect.isfunction(value)}


def all_functions(*functions: Function) -> Iterator[Function]:
    """Yield functions and all plain Python functions that they call, each once."""
    functions_seen: dict[Function, None] = {}
    waiting = list(functions)
    while waiting:
        function = waiting.pop()
        if function not in functions_seen:
            functions_seen[function] = None
            waiting += callees(function).values()
    yield from functions_seen
