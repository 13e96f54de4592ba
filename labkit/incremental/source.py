"""Input files of the Incremental Driver as numbered lines, and the numbers in them as Fortran reads them.

Values are separated by blanks or commas; the text after the values that a line needs is ignored, as is everything after
# or !. Empty lines and lines with a comment only are skipped.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

from labkit.errors import InputError

LARGEST_FILE = 50_000_000  # bytes
REAL = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?")
WHOLE = re.compile(r"[+-]?\d+")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0e-\x1f\x7f-\x9f]")


class Line(NamedTuple):
    """A line without its comment, and its number from 1."""

    number: int
    text: str


class Source:
    """The lines of a file, read one after another."""

    def __init__(self, file: Path) -> None:
        """Reads the whole file. Raises InputError if it is not a text file."""
        self.file = file
        self.raw = _text(file).splitlines()
        self._at = 0  # lines read so far

    def error(self, line: int, problem: str) -> InputError:
        """The InputError for a problem in a line."""
        return InputError(f"{self.file}, line {line}: {problem}")

    @property
    def number(self) -> int:
        """Number of the line read last."""
        return self._at

    def whole_line(self) -> str | None:
        """The next line with its comment, or None at the end of the file."""
        if self._at == len(self.raw):
            return None
        self._at += 1
        return self.raw[self._at - 1]

    def next(self) -> Line | None:
        """The next line that is not empty, or None at the end of the file."""
        while (line := self.whole_line()) is not None:
            text = without_comment(line)
            if text:
                return Line(self._at, text)
        return None

    def need(self, what: str) -> Line:
        """The next line that is not empty. Raises InputError, naming `what` it should hold, if there is none."""
        line = self.next()
        if line is None:
            raise self.error(max(self._at, 1), f"the file ends before {what}")
        return line

    def data(self, what: str) -> Line:
        """The next line of data. Raises InputError if there is none, or if a keyword comes instead."""
        line = self.need(what)
        if line.text.startswith("*"):
            raise self.error(line.number, f"{word(line.text)} where {what} should be: give the missing line")
        return line

    def reals(self, count: int, what: str) -> list[float]:
        """The first `count` numbers of the next line of data. Raises InputError."""
        line = self.data(what)
        return self.split(line, count, what)

    def split(self, line: Line, count: int, what: str) -> list[float]:
        """The first `count` numbers of a line. Raises InputError."""
        words = separated(line.text)
        if len(words) < count:
            plural = "" if count == 1 else "s"
            raise self.error(line.number, f"{line.text[:40]!r} where {what} should be: give {count} number{plural}")
        return [self.real(line, one) for one in words[:count]]

    def real(self, line: Line, text: str) -> float:
        """A number, in which the exponent may be written with d. Raises InputError."""
        if not REAL.fullmatch(text):
            raise self.error(line.number, f"{shortened(text)} is not a number: give one, e.g. -0.15 or 1.0d-3")
        value = float(text.lower().replace("d", "e"))
        if not math.isfinite(value):
            raise self.error(line.number, f"{shortened(text)} is too large: give a smaller number")
        return value

    def whole(self, line: Line, text: str, low: int, high: int, what: str) -> int:
        """A whole number from `low` to `high`. Raises InputError."""
        if not WHOLE.fullmatch(text) or len(text) > 20 or not low <= int(text) <= high:
            raise self.error(
                line.number, f"{shortened(text)} is not valid as {what}: give a whole number, {low} to {high}"
            )
        return int(text)


def _text(file: Path) -> str:
    """The text of a file. Raises InputError if it cannot be read or is not text."""
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise InputError(f"{file} is larger than {LARGEST_FILE // 1_000_000} MB: give an input file of the driver")
        data = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give an input file of the driver") from None
    except ValueError:  # a null character in the name
        raise InputError(f"{str(file)!r} is not a file name: give an input file of the driver") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # comments in older files
    if _CONTROL.search(text):
        raise InputError(f"{file} is not a text file: give an input file of the driver")
    return text


def without_comment(text: str) -> str:
    """A line without the text after # or !, and without surrounding blanks."""
    return re.split(r"[#!]", text, maxsplit=1)[0].strip()


def separated(text: str) -> list[str]:
    """The values of a line."""
    return [word for word in re.split(r"[\s,]+", text.strip()) if word]


def word(text: str) -> str:
    """The first word of a text, in quotes."""
    return shortened((separated(text) or [""])[0])


def shortened(text: str) -> str:
    """A text in quotes, cut after 40 characters."""
    return repr(text if len(text) <= 40 else f"{text[:40]}...")
