"""Input files of the Incremental Driver as numbered lines, and the numbers in them as Fortran reads them.

Values are separated by blanks or commas; text after the values that a line needs is ignored, as is everything after #
or !. Empty lines and lines with only a comment are skipped.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from labkit.errors import InputError
from labkit.text.reading import text_of
from labkit.units import DECIMAL

LARGEST_FILE = 50_000_000  # bytes
REAL = re.compile(rf"[+-]?{DECIMAL}(?:[eEdD][+-]?\d++)?+")
WHOLE = re.compile(r"[+-]?\d+")
INSTEAD = "give an input file of the driver"


class Line(NamedTuple):
    """A line of a file without its comment, and its number from 1."""

    file: Path
    number: int
    text: str

    @property
    def words(self) -> list[str]:
        """Values of the line."""
        return split_words(self.text)

    @property
    def first(self) -> str:
        """First value of the line, or the whole line if it consists of commas."""
        return (self.words or [self.text])[0]

    def error(self, problem: str) -> InputError:
        """Return the InputError for a problem in this line."""
        return InputError(f"{self.file}, line {self.number}: {problem}")

    def reals(self, count: int, what: str) -> list[float]:
        """Return the first `count` numbers of the line. Raises InputError."""
        if len(self.words) < count:
            plural = "" if count == 1 else "s"
            raise self.error(f"{self.text[:40]!r} where {what} should be: give {count} number{plural}")
        return [self.real(word) for word in self.words[:count]]

    def real(self, text: str) -> float:
        """Parse a number, in which d may mark the exponent, as in Fortran. Raises InputError."""
        if not REAL.fullmatch(text):
            raise self.error(f"{shorten(text)} is not a number: give one, e.g. -0.15 or 1.0d-3")
        try:
            return real_of(text)
        except InputError as error:
            raise self.error(str(error)) from None

    def whole(self, text: str, low: int, high: int, what: str) -> int:
        """Parse a whole number from `low` to `high`. Raises InputError."""
        if not WHOLE.fullmatch(text) or len(text) > 20 or not low <= int(text) <= high:
            raise self.error(f"{shorten(text)} is not valid as {what}: give a whole number, {low} to {high}")
        return int(text)


class Source:
    """The lines of a file, read one after another."""

    def __init__(self, file: Path) -> None:
        """Read the whole file. Raises InputError if it is not a text file."""
        self.file = file
        if file.is_file() and file.stat().st_size > LARGEST_FILE:
            raise InputError(f"{file} is larger than {LARGEST_FILE // 1_000_000} MB: {INSTEAD}")
        self.raw = text_of(file, INSTEAD).splitlines()
        self._at = 0  # number of lines read so far

    @property
    def last(self) -> Line:
        """The line that was read last, or the first line if none was read."""
        number = max(self._at, 1)
        return Line(self.file, number, without_comment("".join(self.raw[number - 1 : number])))

    def go_to(self, line: int) -> None:
        """Continue at a line, counted from 0."""
        self._at = line

    def next(self) -> Line | None:
        """Return the next line that is not empty, or None at the end of the file."""
        while self._at < len(self.raw):
            self._at += 1
            if self.last.text:
                return self.last
        return None

    def need(self, what: str) -> Line:
        """Return the next line that is not empty; `what` describes it for the InputError at the end of the file."""
        line = self.next()
        if line is None:
            raise self.last.error(f"the file ends before {what}")
        return line

    def data(self, what: str) -> Line:
        """Return the next line of data. Raises InputError if there is none, or if the next line is a keyword."""
        line = self.need(what)
        if line.text.startswith("*"):
            raise line.error(f"{shorten(line.first)} where {what} should be: give the missing line")
        return line

    def reals(self, count: int, what: str) -> list[float]:
        """Return the first `count` numbers of the next line of data. Raises InputError."""
        return self.data(what).reals(count, what)

    def count(self, what: str, low: int, high: int) -> int:
        """Read the whole number at the start of the next line of data. Raises InputError."""
        line = self.data(what)
        return line.whole(line.first, low, high, what)


def without_comment(text: str) -> str:
    """Return a line without comments, which start with # or !, and without surrounding blanks."""
    return re.split(r"[#!]", text, maxsplit=1)[0].strip()


def split_words(text: str) -> list[str]:
    """Return the values of a line."""
    return [word for word in re.split(r"[\s,]+", text.strip()) if word]


def real_of(text: str) -> float:
    """Return the number in a text that matches REAL. Raises InputError, without a line number, if it is too large."""
    value = float(text.lower().replace("d", "e"))
    if not math.isfinite(value):
        raise InputError(f"{shorten(text)} is too large: give a smaller number")
    return value


def signed_terms(pattern: re.Pattern[str], text: str, example: str) -> list[re.Match[str]]:
    """Split a sum into terms; the pattern's first group is the sign. Raises InputError, without a line number."""
    terms: list[re.Match[str]] = []
    while rest := text[terms[-1].end() if terms else 0 :]:
        match = pattern.match(text, len(text) - len(rest))
        if match is None or (terms and not match[1]):
            raise InputError(f"{shorten(rest.strip())} is not understood{example}")
        terms.append(match)
    return terms


def shorten(text: str) -> str:
    """Return a text in quotation marks, cut after 40 characters."""
    return repr(text if len(text) <= 40 else f"{text[:40]}...")


MOST_ROWS = 20_000
MOST_COLUMNS = 100


def imported_rows(source: Source, line: Line, name: str, columns: int, increments: int) -> np.ndarray:
    """Read the first `increments` + 1 rows of a table in the folder of the test file, (n, columns).

    Lines before the first one that starts with a number are skipped. Raises InputError with the line that names the
    file, or with the line of the table.
    """
    if not name or "\0" in name:
        raise line.error("*ImportFile names no file: write *ImportFile FILE | COLUMNS")
    file = source.file.parent / Path(name)
    if not file.is_file():
        raise line.error(f"the file {shorten(name)} does not exist: give one in {file.parent}")
    try:
        rows = _rows(Source(file), columns, min(increments, MOST_ROWS) + 1)
    except InputError as error:
        raise line.error(str(error)) from None
    if len(rows) < 2:
        raise line.error(f"{file} has {len(rows)} rows of numbers: give at least two")
    return np.array(rows)


def _rows(source: Source, columns: int, most: int) -> list[list[float]]:
    rows: list[list[float]] = []
    while len(rows) < most and (line := source.next()) is not None:
        if rows or REAL.match(line.first):
            rows.append(line.reals(columns, f"{columns} columns"))
    return rows
