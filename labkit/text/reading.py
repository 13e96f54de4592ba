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
from labkit.text.foreign import content_of, note_file

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
THOUSANDS = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:(?:\{mark}|{BETWEEN})\d{{3}})+") for mark in ",."}
COMMENTS = ("#", "%", "//", "!")
BLANKS = "  "  # tabs, or two or more blanks, between names that contain single ones
SEPARATORS = (",", ";", "\t", None)  # None stands for blanks and tabs
LOOK = 200  # number of lines from which the layout of a table is determined
LONGEST = 100  # largest number of characters in a number
MOST_COLUMNS = 1000
MOST_TITLES = 20  # largest number of lines above the rows of a table, not counting comments
MOST_LINES = 20  # largest number of lines in a cell in quotes
FEW_PROSE = 2  # lines without numbers that a table of any length may have

Row = tuple[int, list[str]]  # number of the line, from 1, and its cells


def decode(content: bytes, encoding: str | None = None) -> str:
    """Decode text in an encoding, by default that of its byte order mark, UTF-8 or Windows-1252, in this order.

    Line ends become newlines. Raises InputError for an unknown encoding.
    """
    marked = next((name for mark, name in MARKS.items() if content.startswith(mark)), None)
    try:
        text = content.decode(encoding or marked or "utf-8", "replace" if encoding or marked else "strict")
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    except (LookupError, UnicodeError):
        allowed = "the name of an encoding, e.g. cp1252, mac_roman or shift_jis"
        raise InputError("is unknown", field="encoding", value=encoding, allowed=allowed) from None
    return text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")


def same(text: str) -> str:
    """Normalise a text, so texts that look the same are equal: one form of letters, of blanks and of the letter mu."""
    return " ".join(unicodedata.normalize("NFC", text.replace("\u00b5", "\u03bc")).split())


def text_of(file: Path, instead: str = "give another file or another --format", encoding: str | None = None) -> str:
    """Read the text of a regular file, after decompression with gzip. Raises InputError if it is not text.

    Args:
        file: The file.
        instead: What to give instead, for messages.
        encoding: Its encoding; None for the one that `decode` finds.
    """
    try:
        content = content_of(file)
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): {instead}") from None
    note_file(file)
    kind = next((what for start, what in OTHERS.items() if content.startswith(start)), None)
    if kind is not None:
        raise InputError(f"{file} is {kind}")
    text = decode(content, encoding).removesuffix("\x1a")
    if CONTROL.search(text):
        raise InputError(f"{file} is not text: {instead}")
    return text


def real(word: str) -> float:
    """Return the number in a word, also in Fortran notation (`1.0D-03`). Raises ValueError if it is not a number."""
    plain = word.strip().replace("\u2212", "-")
    if "_" not in plain and len(plain) <= LONGEST:
        try:
            return float(plain)
        except ValueError:
            if match := FORTRAN.fullmatch(plain):
                return float(f"{match[1] or match[3]}e{match[2] or match[4]}")
    raise ValueError(f"{word[:40]!r} is not a number")


def whole(word: str, least: int = 0) -> int:
    """Return the whole number in a word. Raises ValueError for another number, or for one below `least`."""
    number = real(word)
    if not (least <= number < 2**53 and number.is_integer()):
        raise ValueError(f"{word[:40]!r} is not a whole number{' from 0' * (least == 0)}")
    return int(number)


def is_real(word: str) -> bool:
    """Return True if a word is a number."""
    try:
        real(word)
    except ValueError:
        return False
    return True


def numeral(word: str, commas: bool = False) -> float:
    """Return the number in a cell, with decimal commas if `commas`; thousands may be separated. Raises ValueError."""
    mark, other = (",", ".") if commas else (".", ",")
    before, point, after = word.strip().replace("\u2212", "-").partition(mark)
    if len(before) <= LONGEST and THOUSANDS[other].fullmatch(before):
        before = re.sub(f"[,.]|{BETWEEN}", "", before)
    if other in before + after or (commas and point and not after[:1].isdigit()):
        raise ValueError(f"{word[:40]!r} is not a number")
    return real(f"{before}.{after}" if point else before)


def is_numeral(cell: str) -> bool:
    """Return True for a number with any decimal mark."""
    return not all(np.isnan(number_or_nan(cell, commas)) for commas in (False, True))


def number_or_nan(cell: str, commas: bool = False) -> float:
    """Return the number in a cell; NaN for another text."""
    try:
        return numeral(cell, commas)
    except ValueError:
        return np.nan


def decimal_marks(words: Iterable[str]) -> dict[str, str]:
    """Return examples of numbers: "," for a decimal comma, "." for a decimal point, "either ," and "either .".

    There are none without a comma. `1,234` has thousands in some tables and decimals in others; `0,234`, `12,5` and
    `1.234,5` have decimals.
    """
    examples: dict[str, str] = {}
    marked = {word.strip() for word in words if "," in word or "." in word}
    if not any("," in word for word in marked):  # then nothing has to be decided
        return examples
    for word in sorted(marked):
        point, comma = number_or_nan(word, False), number_or_nan(word, True)
        if np.isfinite(point) and np.isfinite(comma):
            examples.setdefault("either ," if "," in word else "either .", word)
        elif np.isfinite(point) or np.isfinite(comma):
            examples.setdefault("." if np.isfinite(point) else ",", word)
    return examples


def split(line: str, separator: str | None) -> list[str]:
    """Split a line into cells, with quotes as in CSV; at blanks if `separator` is None, but not before a unit."""
    return next((cells for _, cells in rows_of(line, separator)), [])


def rows_of(text: str, separator: str | None) -> list[Row]:
    """Return the lines of a text that are not empty, as cells; a cell in quotes may contain newlines.

    `separator` is None for blanks, or BLANKS for two or more of them. Raises InputError if a quote is not closed.
    """
    lines = text.split("\n")
    if separator is None:
        return [
            (number, [cell.strip('"') for cell in re.sub(r"(?<![\s\])])[ \t]+(?=[\[(])", "", line).split()])
            for number, line in enumerate(lines, 1)
            if line.strip()
        ]
    if separator == BLANKS:
        return [(k, re.split(r"[ ]*\t[ ]*|[ ]{2,}", line.strip())) for k, line in enumerate(lines, 1) if line.strip()]
    reader, rows, before = (
        csv.reader((f"{line}\n" for line in lines), delimiter=separator, skipinitialspace=True),
        [],
        0,
    )
    try:
        for cells in reader:
            if reader.line_num - before > MOST_LINES:
                raise InputError(f"line {before + 1} opens a quote that is not closed: repair the table")
            if len(cells) > 1 or (cells and cells[0].strip()):
                rows.append((before + 1, [cell.strip() for cell in cells]))
            before = reader.line_num
    except csv.Error:
        raise InputError(f"line {before + 1} has a cell that is too long: repair the table") from None
    return rows


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

    def where(self, mask: Sequence[bool]) -> Sheet:
        """Return a Sheet of the rows for which `mask`, one value per row, is true."""
        chosen = [number for number, keep in enumerate(mask) if keep]
        rows = [self.rows[number] for number in chosen]
        return dataclasses.replace(self, rows=rows, lines=[self.lines[number] for number in chosen])

    def numbers(self, where: object) -> np.ndarray:
        """Return the cells as numbers, (row, column), NaN for other text. Raises InputError for a row that is too long.

        `where` is the file, for the message.
        """
        width = min(map(len, self.rows), default=0)
        if width > MOST_COLUMNS:
            raise InputError(f"{where} has {width} columns: give a table of at most {MOST_COLUMNS}")
        for line, row in zip(self.lines, self.rows, strict=True):
            if len(row) > width:
                raise InputError(f"{where} has {len(row)} cells in line {line}, not {width}: repair the table")
        return np.array([[number_or_nan(cell, self.commas) for cell in row] for row in self.rows]).reshape(
            len(self.rows), width
        )


def read_table(text: str, where: object, least: int = 2) -> Sheet:
    """Read the table in a text; its columns are separated by tabs, semicolons, commas or blanks.

    Lines above the first row may be titles, names and units; comments begin with #, %, // or !. Raises InputError.

    Args:
        text: The text.
        where: File, for messages.
        least: Least number of numbers in a row.
    """
    filled = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]
    comments = [(number, line.strip()) for number, line in filled if line.lstrip().startswith(COMMENTS)]
    lines = [(number, line) for number, line in filled if not line.lstrip().startswith(COMMENTS)]
    if not lines:
        raise InputError(f"{where} has no rows: give a table")
    separator = max(SEPARATORS, key=lambda mark: _share(lines[:LOOK], mark, least))
    rows = [_cells(line, separator) for _, line in lines]
    dense = [k for k, row in enumerate(rows[:LOOK]) if _dense(row, separator, least)]
    if not dense:
        raise InputError(f"{where} has no rows of {least} or more numbers: give a table")
    width = collections.Counter(len(rows[k]) for k in dense).most_common(1)[0][0]
    first = next(k for k in dense if len(rows[k]) == width)
    above = len(rows[first - 1]) if first else width
    if above < width and not any("".join(rows[k][above:]) for k in dense):
        width = above  # rows end with separators, but their header does not
    if first > MOST_TITLES:
        raise InputError(f"{where} has {first} lines of text before its first row: leave them out")
    heads = [line for _, line in lines[:first]]
    if not heads and comments and separator and comments[-1][0] < lines[0][0] and comments[-1][1].startswith("%"):
        heads = [comments[-1][1]]  # a heading in percent, such as `% passing`
    names, used = _names(heads, separator, width)
    titles = max(first - used, 0)
    below, numbers = rows[first:], [number for number, _ in lines[first:]]
    prose = [number for number, row in zip(numbers, below, strict=True) if not any(map(is_numeral, row))]
    if len(prose) > max(FEW_PROSE, len(below) / 10):
        text = f"{len(prose)} of {len(below)} lines from line {numbers[0]} on have no numbers, first line {prose[0]}"
        raise InputError(f"{where} is not a table: {text}: give a table")
    notes = [f"{titles} lines above the table are not read"] if titles else []
    marks = decimal_marks(cell for row in below[:LOOK] for cell in row)
    commas = separator != "," and ("," in marks or ("either ," in marks and "." not in marks))
    notes += ["its decimal commas are read as points"] if commas else []
    if commas and (word := marks.get("either .")):
        notes.append(f"{word} is read as {numeral(word, True):.0f}, because other numbers have decimal commas")
    for row in below:
        while len(row) > width and not row[-1]:
            row.pop()  # empty cells after the last column
        row.extend([""] * (width - len(row)))
    texts = [line.lstrip("#%/! \t") for _, line in comments] + [line.strip() for line in heads[:titles]]
    return Sheet(names, below, numbers, texts, tuple(notes), titles, commas)


def _cells(line: str, separator: str | None) -> list[str]:
    """Split a row, without a comment after its numbers."""
    row, mark, _ = line.partition("#")
    cells = split(row, separator) if mark else []
    return cells if any(map(is_numeral, cells)) else split(line, separator)


def _count(cells: Sequence[str], separator: str | None) -> int:
    """Return the number of cells that are numbers, also with a decimal comma."""
    return sum(is_real(cell) or (separator != "," and is_numeral(cell)) for cell in cells)


def _dense(row: Sequence[str], separator: str | None, least: int) -> bool:
    """Return True if numbers fill at least half of the cells."""
    return _count(row, separator) >= max(least, sum(map(bool, row)) / 2)


def _share(lines: Sequence[tuple[int, str]], separator: str | None, least: int) -> tuple[int, float]:
    """Return how well a separator fits: the number of rows with numbers, and the fraction of numbers in their cells."""
    rows = [row for _, line in lines if _dense(row := _cells(line, separator), separator, least)]
    cells = [cell for row in rows for cell in row if cell]
    return len(rows), _count(cells, separator) / max(len(cells), 1)


def _names(above: Sequence[str], separator: str | None, width: int) -> tuple[list[str] | None, int]:
    """Return the names of columns, with units, from the lines above the first row, and the number of lines used."""
    wide: list[list[str]] = []
    for line in above[-2:]:
        cells = (split(text, separator) for text in (line, line.partition("#")[0]))
        wide.append(next((row for row in cells if len(row) == width and not any(map(is_real, row))), []))
    if not wide or not wide[-1]:
        return None, 0
    units = [cell.strip("[]() ") for cell in wide[-1]]
    if len(wide) > 1 and wide[-2] and all(len(unit) <= 5 for unit in units) and set(units) & {"m", "mm", "um", "N"}:
        return [f"{name} [{unit}]" if unit.strip("-") else name for name, unit in zip(wide[-2], units, strict=True)], 2
    return wide[-1], 1
