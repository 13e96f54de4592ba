"""Base class of the dataclasses that users create; its errors name the argument that is wrong or missing."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from labkit.errors import InputError, instead_of


class _OfInit:
    """The signature of a class with the arguments of its __init__, which documentation and notebooks show."""

    def __get__(self, value: object, kind: type) -> inspect.Signature:
        signature = inspect.signature(inspect.getattr_static(kind, "__init__"))
        return signature.replace(parameters=list(signature.parameters.values())[1:])


@functools.cache
def arguments_of(kind: Any) -> Mapping[str, inspect.Parameter]:
    """Return the arguments of the constructor of a class, name -> inspect.Parameter."""
    return inspect.signature(kind).parameters


class Named:
    """Base class of the dataclasses that users create; it rejects a misspelled argument and lists the valid names."""

    __signature__ = _OfInit()
    _created_by: ClassVar[str] = ""  # function with the same arguments by which users create the class

    def __new__(cls, *values: object, **named: object) -> Self:
        """Raise InputError for an unknown or a missing argument."""
        kind: Any = cls
        known = arguments_of(kind)
        if not any(one.kind is one.VAR_KEYWORD for one in known.values()):
            for name in sorted(named.keys() - known.keys()):
                problem = f"is not an argument of {cls._created_by or cls.__name__}"
                raise InputError(problem, field=name, allowed=instead_of(known, name))
        needed = [name for name, one in list(known.items())[len(values) :] if one.default is one.empty]
        for name in needed if values or named else ():  # copy and pickle call __new__ without arguments
            if name not in named and known[name].kind is known[name].POSITIONAL_OR_KEYWORD:
                problem = f"is an argument that {cls._created_by or cls.__name__} needs"
                raise InputError(problem, field=name, allowed=f"{name}=...")
        return super().__new__(cls)
