"""labkit's exceptions and their exit codes. Each front end can word the message of an InputError."""

from __future__ import annotations

import difflib
import inspect
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable
from typing import Any


class InputError(ValueError):
    """Invalid input: exit code 2, a one-line message, no output file left behind.

    `str()` uses the Python name of the field; a front end can use a different name, such as the name of an option.

    Args:
        problem: Text after the field's name and value; without a field, the complete message.
        field: Python name of the invalid parameter.
        value: The value given.
        allowed: The valid values, in words.
        quoted: True to print the value in quotes.
    """

    def __init__(
        self,
        problem: str = "is not valid",
        *,
        field: str | None = None,
        value: object = None,
        allowed: str | None = None,
        quoted: bool = False,
    ) -> None:
        """Store the values from which the message is composed."""
        super().__init__(problem)
        self.problem, self.field, self.value, self.allowed, self.quoted = problem, field, value, allowed, quoted

    def message(self, name: Callable[[str], str] = str) -> str:
        """Compose the message, in which the field appears as `name(field)`."""
        if self.field is None:
            return self.problem
        value = "" if self.value is None else f" {repr(self.value) if self.quoted else as_typed(self.value)}"
        advice = "" if self.allowed is None else f": give {self.allowed}"
        return f"{name(self.field)}{value} {self.problem}{advice}"

    def __str__(self) -> str:
        return self.message()


class ImpossibleError(InputError):
    """Grains that cannot exist; `allowed` says what to give from Python instead."""

    @property
    def finding(self) -> str:
        """What is wrong, without the advice, for the message of a damaged file."""
        return f"{self.field} {self.problem}"

    @classmethod
    def unless(cls, holds: object, field: str, problem: str, allowed: str) -> None:
        """Raise the error unless a condition holds."""
        if not holds:
            raise cls(problem, field=field, allowed=allowed)


def require_type(value: object, kind: type, field: str, example: str) -> None:
    """Raise InputError if an argument is not of type `kind`, for instance because two arguments are swapped."""
    if not isinstance(value, kind):
        actual = type(value).__name__
        raise InputError(f"is not a {kind.__name__}", field=field, value=actual, allowed=f"e.g. {example}")


def require_file_name(value: object, call: str) -> None:
    """Raise InputError if an argument is not a file name; `call` is an example of the right call."""
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{type(value).__name__} is not a file name: write {call}")


def nearest(name: object, valid: Iterable[str]) -> str | None:
    """Return the known name most similar to a misspelled name, ignoring case; None if no name is similar."""
    names = {choice.lower(): choice for choice in valid}
    close = difflib.get_close_matches(str(name)[:100].lower(), names, 1)
    return names[close[0]] if close else None


def instead_of(valid: Iterable[str], name: object = None) -> str:
    """List the valid names after an unknown name, for an error message; the most similar name comes first.

    A Registry lists its own names, and says how more are loaded.
    """
    if worded := getattr(valid, "instead_of", None):
        return str(worded(name))
    names = tuple(valid)
    close = None if name is None else nearest(name, names)
    return f"{'one of' if close is None else f'{close!r}, or another of'} {', '.join(names)}"


def as_typed(value: object) -> str:
    """Format a value as a user would type it."""
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return ",".join(as_typed(item) for item in value)
    return str(value)


class PhysicsError(RuntimeError):
    """The simulation, or a check of its results, failed: exit code 1.

    `run` is the labkit.Run up to the failure if labkit.run raised the error after a record was saved, otherwise None.
    """

    run: Any = None


class ProgramError(PhysicsError):
    """The program of an engine ended or does not answer; the run adds what its file holds."""


class Interrupted(KeyboardInterrupt):
    """A signal stopped a run after its checkpoint was written: exit code 128 + signal number, as in shells.

    It is not an Exception: a library, or a user's loop over several runs, may catch every Exception and go on.
    """

    def __init__(self, message: str, code: int) -> None:
        """Store the message and the exit code."""
        super().__init__(message, code)
        self.code = code

    def __str__(self) -> str:
        return str(self.args[0])


def option_name(field: str) -> str:
    """Return the command-line option of a parameter: `--step1-friction` for `step1_friction`."""
    return f"--{field.replace('_', '-')}"


def exit_code(error: BaseException) -> int:
    """Return the exit code of a command that stops with this error."""
    if isinstance(error, KeyboardInterrupt):
        return getattr(error, "code", 130)
    return 2 if isinstance(error, InputError) else 1


def sentence(error: BaseException, name: Callable[[str], str] = str) -> str:
    """Return the message that a front end prints for an error."""
    if isinstance(error, InputError):
        return error.message(name)
    if isinstance(error, OSError):
        return f"{error.filename or 'a file'}: {error.strerror or error}"
    if isinstance(error, KeyboardInterrupt):
        return str(error) or "interrupted"  # that of Python has no text
    return str(error)


class LabkitWarning(UserWarning):
    """A doubt about what the user gave, or a limit that the results exceed."""


def warn(*texts: str | None) -> None:
    """Issue warnings, if any, at the user's line: the first one outside of labkit."""
    frames = [frame for frame, _ in traceback.walk_stack(inspect.currentframe())]
    names = [str(frame.f_globals.get("__name__")).partition(".")[0] for frame in frames]
    level = next((number for number, name in enumerate(names, 1) if name != "labkit"), 2)
    for text in filter(None, texts):
        warnings.warn(text, LabkitWarning, stacklevel=level)


CONTROL = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")  # also what reverses a text


def printable(text: str) -> str:
    """Return a text in which control characters, which could hide text or rename a window, are escapes."""
    return CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


def notice(message: object) -> None:
    """Print a notice to standard error."""
    print(printable(f"labkit: {message}"), file=sys.stderr, flush=True)


def fail(message: object, code: int) -> int:
    """Print the one-line message of a failed command and return its exit code."""
    notice(message)
    return code
