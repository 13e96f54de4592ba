"""How labkit gives up, each way with its exit code. An error carries values; a front end makes the sentence."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


class InputError(ValueError):
    """Something the user gave cannot be used: exit code 2, one line, nothing left behind.

    field: the parameter that is wrong, by its name in Python; value: what was given; allowed: what to give instead;
    quoted: whether the sentence has the value in quotes. `str()` names the field as Python does; `said(name)` lets a
    front end name it in its own way.
    """

    def __init__(
        self,
        problem: str = "is not possible",
        *,
        field: str | None = None,
        value: Any = None,
        allowed: str | None = None,
        quoted: bool = False,
    ) -> None:
        """problem: what is wrong with the field, after its name and value; a whole sentence without a field."""
        super().__init__(problem)
        self.problem, self.field, self.value, self.allowed, self.quoted = problem, field, value, allowed, quoted

    def said(self, name: Callable[[str], str] = str) -> str:
        """The sentence, with `name(field)` for the name of the field."""
        if self.field is None:
            return self.problem
        value = "" if self.value is None else f" {repr(self.value) if self.quoted else shown(self.value)}"
        advice = "" if self.allowed is None else f": give {self.allowed}"
        return f"{name(self.field)}{value} {self.problem}{advice}"

    def __str__(self) -> str:
        return self.said()


def shown(value: Any) -> str:
    """A value as a person would write it."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return ",".join(shown(one) for one in value)
    return str(value)


class PhysicsError(RuntimeError):
    """The simulation or a check of it failed: exit code 1."""


class Interrupted(Exception):
    """A signal ended a run after its checkpoint was written: exit code 128 + number, as shells have it."""

    def __init__(self, message: str, code: int) -> None:
        """code: the exit code."""
        super().__init__(message)
        self.code = code


def option_name(field: str) -> str:
    """`--step1-friction` for `step1_friction`."""
    return f"--{field.replace('_', '-')}"


def exit_code(error: BaseException) -> int:
    """The exit code of a command that this error ends."""
    if isinstance(error, Interrupted):
        return error.code
    return 2 if isinstance(error, InputError) else 1


def sentence(error: BaseException, name: Callable[[str], str] = str) -> str:
    """What a front end says of an error."""
    if isinstance(error, InputError):
        return error.said(name)
    if isinstance(error, OSError):
        return f"{error.filename or 'a file'}: {error.strerror or error}"
    return str(error)


def fail(message: object, code: int) -> int:
    """Prints the one line that a command gives up with, and returns its exit code."""
    print(f"labkit: {message}", file=sys.stderr, flush=True)
    return code
