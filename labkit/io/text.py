"""Reads text files of other programs: encodings, numbers, and tables below titles, headers and comments."""

from __future__ import annotations

import codecs
import collections
import csv
import dataclasses
import re
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.io.foreign import content_of

MARKS = {  # mark at the start of a file -> its encoding
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",  # begins like UTF-16
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
OTHERS = {  # first bytes of a file -> type of the file
    b"PK\x03\x04": "a zip archive or an Excel workbook: save its table as CSV",
    b"\xd0\xcf\x11\xe0": "an Excel workbook: save its table as CSV",
    b"\xfd7zXZ": "compressed with xz: unpack it first",
    b"BZh": "compressed with bzip2: unpack it first",
    b"\x28\xb5\x2f\xfd": "compressed with zstd: unpack it first",
}
CONTROL = re.compile(r"[\0-\x08\x0e-\x19\x1b-\x1f]")
FORTRAN = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dDqQ]([+-]?\d+)|([+-]?\d*\.\d*)([+-]\d{3})")
BETWEEN = "[ '\u2019\u00a0\u202f]"  # marks between thousands that are no decimal marks


def _thousands(mark: str) -> str:
    return rf"[+-]?[1-9]\d{{0,2}}(?:(?:{mark}|{BETWEEN})\d{{3}})+"


def _decimals(decimal: str, mark: str) -> re.Pattern[str]:
    """Return the pattern of a number with decimals, the whole part of which may have separated thousands."""
    return re.compile(rf"(?=.*\d)(?:{_thousands(mark)}|[+-]?\d*){decimal}\d*(?:[eEdD][+-]?\d+)?")


WHOLE = {False: re.compile(_thousands(",")), True: re.compile(_thousands(r"\."))}  # by: commas are decimal marks
GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:\{mark}\d{{3}})+") for mark in ",."}
DECIMALS = {",": _decimals(",", r"\."), ".": _decimals(r"\.", ",")}
COMMENTS = ("#", "%", "//", "!")
SEPARATORS = (",", ";", "\t", None)  # None stands for blanks
BLANKS = "  "  # two or more blanks, between names that contain single ones
LOOK = 200  # number of lines from which the layout of a table is determined
MOST_COLUMNS = 1000
MOST_TITLES = 20  # largest number of lines above the rows of a table, not counting comments
CODEPAGES = ("cp1252", "mac_roman", "shift_jis", "gb18030", "cp1253", "cp1250", "cp1251", "cp850")


def decode(content: bytes, words: Iterable[str] = ()) -> str:
    """Decode text by its byte order mark, which is dropped; without a mark as UTF-8, or else by a code page.

    The code page is the first one with which the text contains `words`, such as the headers of a table; otherwise
    Windows-1252. Line ends become newlines.
    """
    encoding = next((name for mark, name in MARKS.items() if content.startswith(mark)), None) or _wide(content)
    try:
        text = content.decode(encoding or "utf-8", "strict" if encoding is None else "replace")
    except UnicodeDecodeError:
        texts = (content.decode(name, "replace") for name in CODEPAGES)
        fits = (one for one in texts if all(same(word) in same(one) for word in words))
        text = next(fits, content.decode("cp1252", "replace"))
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _wide(content: bytes) -> str | None:
    """Return the encoding of lines in UTF-16 without a mark: every other byte of most text is zero."""
    first, second = content[:LOOK:2], content[1:LOOK:2]
    lines, zeros = b"\n" in content or b"\r" in content, max(first.count(0), second.count(0))
    if not lines or len(content) % 2 or 2 * zeros <= len(first):
        return None
    return None if first.count(0) and second.count(0) else f"utf-16-{'be' if first.count(0) else 'le'}"


def same(text: str) -> str:
    """Normalise a text, so texts that look the same are equal: one form of letters, of blanks and of the letter mu."""
    return " ".join(unicodedata.normalize("NFC", text.replace("\u00b5", "\u03bc")).split())


def text_of(file: Path, instead: str = "give another file or another --format", words: Iterable[str] = ()) -> str:
    """Read the text of a regular file, after decompression with gzip. Raises InputError if it is not text.

    Args:
        file: The file.
        instead: What to give instead, for messages.
        words: Words that the text contains, by which `decode` finds its code page.
    """
    try:
        content = content_of(file)
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): {instead}") from None
    kind = next((what for start, what in OTHERS.items() if content.startswith(start)), None)
    if kind is not None:
        raise InputError(f"{file} is {kind}")
    text = decode(content, words).removesuffix("\x1a")
    if CONTROL.search(text):
        raise InputError(f"{file} is not text: {instead}")
    return text


def real(word: str) -> float:
    """Return the number in a word, also in Fortran notation (`1.0D-03`). Raises ValueError if it is not a number."""
    plain = word.strip().replace("\u2212", "-")
    try:
        if "_" not in plain:
            return float(plain)
    except ValueError:
        if found := FORTRAN.fullmatch(plain):
            return float(f"{found[1] or found[3]}e{found[2] or found[4]}")
    raise ValueError(f"{word[:40]!r} is not a number")


def is_real(word: str) -> bool:
    """Return True if a word is a number."""
    try:
        real(word)
    except ValueError:
        return False
    return True


def numeral(word: str, commas: bool = False) -> float:
    """Return the number in a cell, with decimal commas if `commas`; thousands may be separated. Raises ValueError."""
    plain = word.strip().replace("\u2212", "-")
    whole, point, rest = plain.partition("," if commas else ".")
    if WHOLE[commas].fullmatch(whole):
        plain = re.sub(f"[,.]|{BETWEEN}", "", whole) + point + rest
    return real(re.sub(r",(?=\d)", ".", plain) if commas else plain)


def is_numeral(cell: str) -> bool:
    """Return True for a number with any decimal mark."""
    return any(not np.isnan(_or_nan(cell, commas)) for commas in (False, True))


def decimal_marks(words: Iterable[str]) -> dict[str, str]:
    """Return examples of numbers: "," for a decimal comma, "." for a decimal point, "either ," and "either .".

    `1,234` has thousands in some tables and decimals in others; `0,234`, `12,5` and `1.234,5` have decimals.
    """
    found: dict[str, str] = {}
    for word in sorted({one.strip() for one in words}):
        for mark, other in (",.", ".,"):
            if GROUPED[mark].fullmatch(word):
                found.setdefault(f"either {mark}" if word.count(mark) == 1 else other, word)
            elif DECIMALS[mark].fullmatch(word):
                found.setdefault(mark, word)
    return found


@dataclasses.dataclass(frozen=True)
class Sheet:
    """The rows of a table in a text file; the cells are still text.

    Args:
        names: Names of the columns, with units from a row below in brackets; None if no line contains them.
        rows: Cells of each row, at least as many as most rows have.
        lines: Line number of each row in the file, from 1.
        comments: Texts of the comments, without comment characters, and of the lines above the names.
        notes: What was left out or assumed.
        titles: Number of lines above the names.
        commas: True if numbers have decimal commas.
    """

    names: list[str] | None
    rows: list[list[str]]
    lines: list[int]
    comments: list[str]
    notes: tuple[str, ...] = ()
    titles: int = 0
    commas: bool = False

    def where(self, kept: Sequence[bool]) -> Sheet:
        """Return a Sheet of the rows for which `kept`, one value per row, is true."""
        chosen = [number for number, keep in enumerate(kept) if keep]
        rows = [self.rows[number] for number in chosen]
        return dataclasses.replace(self, rows=rows, lines=[self.lines[number] for number in chosen])

    def numbers(self, where: object) -> np.ndarray:
        """Return the cells as numbers, (row, column), NaN for other text. Raises InputError for a row that is too long.

        `where` is the file, for the message.
        """
        width = min(map(len, self.rows), default=0)
        if width > MOST_COLUMNS:
            raise InputError(f"{where} has {width} columns: give a table of at most {MOST_COLUMNS}")
        if long := next((number for number, row in enumerate(self.rows, 1) if len(row) > width), None):
            cells = len(self.rows[long - 1])
            raise InputError(f"{where} has {cells} cells in row {long}, not {width}: repair the table")
        columns = [self._column(column) for column in zip(*self.rows, strict=True)]
        return np.array(columns).T.reshape(len(self.rows), -1)

    def _column(self, column: Sequence[str]) -> list[float]:
        return [_or_nan(cell, self.commas) for cell in column]


def read_table(text: str, where: object, least: int = 2) -> Sheet:
    """Read the table in a text; its columns are separated by tabs, semicolons, commas or blanks.

    Lines above the first row may be titles, names and units; comments begin with #, %, // or !. Raises InputError.

    Args:
        text: The text.
        where: File, for messages.
        least: Least number of numbers in a row.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    comments = [line.strip().lstrip("#%/! \t") for _, line in lines if line.lstrip().startswith(COMMENTS)]
    lines = [(number, line.partition("#")[0]) for number, line in lines if not line.lstrip().startswith(COMMENTS)]
    if not lines:
        raise InputError(f"{where} has no rows: give a table")
    separator = max(SEPARATORS, key=lambda mark: _share(lines[:LOOK], mark, least))
    shown = [split(line, separator) for _, line in lines[:LOOK]]
    dense = [k for k, row in enumerate(shown) if _dense(row, separator, least)]
    if not dense:
        raise InputError(f"{where} has no rows of {least} or more numbers: give a table")
    width = collections.Counter(len(shown[k]) for k in dense).most_common(1)[0][0]
    first = next(k for k in dense if len(shown[k]) == width)
    above = len(shown[first - 1]) if first else width
    if above < width and not any("".join(shown[k][above:]) for k in dense):
        width = above  # rows end with separators, but their header does not
    if first > MOST_TITLES:
        raise InputError(f"{where} has {first} lines of text before its first row: leave them out")
    names, used = _names(shown[:first], width)
    comments += [line.strip() for _, line in lines[: first - used]]
    rows = [split(line, separator) for _, line in lines[first:]]
    notes = [f"{first - used} lines above the table are not read"] if first > used else []
    marks = decimal_marks(cell for row in rows[:LOOK] for cell in row)
    commas = separator != "," and ("," in marks or ("either ," in marks and "." not in marks))
    notes += ["its decimal commas are read as points"] if commas else []
    if commas and (word := marks.get("either .")):
        notes.append(f"{word} is read as {numeral(word, True):.0f}, because other numbers have decimal commas")
    for row in rows:
        del row[width + len("".join(row[width:])) :]  # empty cells after the last column
        row.extend([""] * (width - len(row)))
    return Sheet(names, rows, [number for number, _ in lines[first:]], comments, tuple(notes), first - used, commas)


def _or_nan(cell: str, commas: bool) -> float:
    try:
        return numeral(cell, commas)
    except ValueError:
        return np.nan


def split(line: str, separator: str | None) -> list[str]:
    """Split a line into cells, with quotes as in CSV; at blanks if `separator` is None, but not before a unit."""
    if separator is None:
        return [cell.strip('"') for cell in re.sub(r"(?<=[^\s\])])\s+(?=[\[(])", "", line).split()]
    if separator == BLANKS:
        return re.split(r" *\t *| {2,}", line.strip())
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def _count(cells: Sequence[str], separator: str | None) -> int:
    """Return the number of cells that are numbers, also with a decimal comma."""
    return sum(is_real(cell) or (separator != "," and is_numeral(cell)) for cell in cells)


def _dense(row: Sequence[str], separator: str | None, least: int) -> bool:
    """Return True if numbers fill at least half of the cells."""
    return _count(row, separator) >= max(least, sum(map(bool, row)) / 2)


def _share(lines: Sequence[tuple[int, str]], separator: str | None, least: int) -> tuple[int, float]:
    """Return how well a separator fits: the number of rows with numbers, and the fraction of numbers in their cells."""
    rows = [row for _, line in lines if _dense(row := split(line, separator), separator, least)]
    cells = [cell for row in rows for cell in row if cell]
    return len(rows), _count(cells, separator) / max(len(cells), 1)


def _names(above: Sequence[Sequence[str]], width: int) -> tuple[list[str] | None, int]:
    """Return the names of columns, with units, from the lines above the first row, and the number of lines used."""
    wide = [list(row) if len(row) == width and not any(map(is_real, row)) else [] for row in above]
    if not wide or not wide[-1]:
        return None, 0
    units = [cell.strip("[]() ") for cell in wide[-1]]
    if len(wide) > 1 and wide[-2] and all(len(unit) <= 5 for unit in units) and set(units) & {"m", "mm", "um", "N"}:
        return [f"{name} [{unit}]" if unit.strip("-") else name for name, unit in zip(wide[-2], units, strict=True)], 2
    return wide[-1], 1
