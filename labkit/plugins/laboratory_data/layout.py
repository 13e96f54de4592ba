"""Where the table of a laboratory's file is: separator, headers and rows.

What the user gives (`Form`) comes first. Otherwise the columns are separated by the mark with which most cells in the
wanted columns are numbers. Columns can also be given by their numbers, #1, #2, ..., if there are no headers. A group of
an AGS4 file is such a table, whose lines have labels.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as File
from typing import Literal

from labkit.errors import InputError, instead_of
from labkit.plugins.laboratory_data.units import unit_in_header
from labkit.text.reading import BLANKS, Row, is_numeral, rows_of, same, text_of

MARKS = {"semicolon": ";", "tab": "\t", "bar": "|", "blanks": BLANKS, "blank": None, "comma": ","}
COMMENTED = "#%!/* "  # characters before headers in a comment
DIGITS = "+-.,0123456789"  # no header begins like a number
BY_NUMBER = re.compile(r"#(\d{1,4})")  # a column, counted from 1
FEW = 2  # least number of numbers in the first row of a table without headers
LOOK = 500  # number of rows by which the separator is chosen
Separator = Literal["semicolon", "tab", "blanks", "blank", "bar", "comma"]


@dataclasses.dataclass(frozen=True)
class Form:
    """What the user says about a table; None for what shows itself.

    Args:
        separator: Name of the mark between columns; `blanks` are two or more, `blank` is any number of them.
        decimal: Decimal mark.
        encoding: Encoding of the text.
        header: Number of the line of the headers, from 1, if several lines have them.
        rows: Header -> text; only rows with these texts are read.
        group: Group of an AGS4 file.
        accept: True to leave out rows that cannot be read.
    """

    separator: Separator | None = None
    decimal: Literal["point", "comma"] | None = None
    encoding: str | None = None
    header: int | None = None
    rows: Mapping[str, str] = dataclasses.field(default_factory=dict)
    group: str | None = None
    accept: bool = False


@dataclasses.dataclass(frozen=True)
class LaboratoryTable:
    """One table of a file: headers, the rows below them, header -> unit, and notes.

    Args:
        blank: True if blanks separate the columns, so that no cell can be empty.
        lines: Numbers of the lines with these headers.
    """

    headers: list[str]
    rows: list[Row]
    units: dict[str, str]
    notes: list[str]
    blank: bool = False
    lines: Sequence[int] = ()

    def places(self, name: str) -> list[int]:
        """Return the indices of the columns with this header, or of the column with this number."""
        number = int(name[1:]) if BY_NUMBER.fullmatch(name) else 0
        fits = [k for k, header in enumerate(self.headers) if _key(header) == _key(name)]
        return fits or [number - 1] * (1 <= number <= len(self.headers))

    def place(self, name: str, file: File) -> int:
        """Return the index of the only such column. Raises InputError."""
        places = self.places(name)
        if not places:
            headers = ", ".join(filter(None, self.headers))[:400]
            raise InputError(f"{file} has no column {name}: give #1 to #{len(self.headers)}, or one of {headers}")
        if len(places) > 1:
            numbers = [f"#{k + 1}" for k in places]
            text = f"{file} has the header {name!r} above the columns {' and '.join(numbers)}"
            raise InputError(f"{text}: give the number of a column instead, e.g. {numbers[0]}")
        return places[0]


def find_table(file: File, names: Sequence[str], form: Form) -> LaboratoryTable:
    """Return the table that has these columns. Raises InputError if there is none."""
    text = _text_in(file, form)
    return _best_table(text, file, names, form) if form.group is None else _group_of_ags4(text, file, form.group)


def _text_in(file: File, form: Form) -> str:
    """Return the text of a file. Raises InputError if it is missing, empty or has another form than a table."""
    if not file.exists():
        raise InputError(f"{file} does not exist: give the file of a measured test")
    text = text_of(file, "export the table of the test as CSV, or give --encoding, e.g. utf-16-le", form.encoding)
    if not text.strip():
        raise InputError(f"{file} is empty: give the file of a measured test")
    if text.lstrip().startswith(("<", "{")):
        raise InputError(f"{file} is XML, HTML or JSON: export the table of the test as CSV")
    return text


def cell_of(cells: Sequence[str], place: int) -> str:
    """Return a cell; empty if the row is too short."""
    return cells[place] if place < len(cells) else ""


@functools.lru_cache(10_000)
def _key(header: str) -> str:
    """Normalise a header, so that headers that look the same are equal, also where a blank stands before a bracket."""
    return re.sub(r" (?=[\[(])", "", same(header))


def _keys(headers: Iterable[str]) -> set[str]:
    return set(map(_key, headers))


def _best_table(text: str, file: File, names: Sequence[str], form: Form) -> LaboratoryTable:
    """Return the table with these headers, or with columns of these numbers. Raises InputError."""
    if form.separator not in (None, *MARKS):
        raise InputError(field="separator", value=form.separator, allowed=f"one of {', '.join(MARKS)}")
    marks = [MARKS[form.separator]] if form.separator else [*MARKS.values()]
    rows = {mark: rows_of(text, mark) for mark in marks if mark in (None, BLANKS) or mark in text}
    if not rows:
        raise InputError(f"does not stand in {file}", field="separator", value=form.separator, allowed="another one")
    headers = [name for name in names if not BY_NUMBER.fullmatch(name)]
    tables = [table for mark in rows if (table := _below_headers(rows[mark], headers, form.header, mark))]
    if not tables:
        raise _not_found(file, [row for each in rows.values() for row in each[:LOOK]], headers, form.header)

    def numbers(table: LaboratoryTable) -> int:
        """The number of numbers in the columns, in rows that are not wider than the headers."""
        places, width = [place for name in names for place in table.places(name)[:1]], len(table.headers)
        fit = (cells for _, cells in table.rows[:LOOK] if not any(cells[width:]) and len(cells) >= width * table.blank)
        return sum(is_numeral(cell_of(cells, place)) for cells in fit for place in places)

    best = max(tables, key=numbers)
    if len(best.lines) > 1 and not form.header and not form.accept:
        text = f"{file} has these headers in the lines {' and '.join(map(str, best.lines))}"
        raise InputError(f"{text}: give --header with one of them, or --accept if the table only repeats them")
    return best


def _below_headers(
    rows: Sequence[Row], names: Sequence[str], header: int | None, mark: str | None
) -> LaboratoryTable | None:
    """Return the table below the headers, or from the first row of numbers if no headers are wanted; None if none."""
    blank = mark in (None, BLANKS)
    if not names and not header:
        first = next((k for k, (_, cells) in enumerate(rows) if sum(map(is_numeral, cells)) >= FEW), len(rows))
        numbered = [f"#{k + 1}" for k in range(max((len(cells) for _, cells in rows[first:]), default=0))]
        notes = [f"{first} lines above the first row of numbers are not read"] if first else []
        return LaboratoryTable(numbered, [*rows[first:]], {}, notes, blank) if numbered else None
    heads = {k: cells for k, row in enumerate(rows) if (cells := _headers(row[1], _keys(names))) is not None}
    starts = [k for k in heads if header in (None, rows[k][0])]
    if not starts:
        return None
    end = next((k for k in heads if k > starts[0]), None) if header and names else None
    headers = heads[starts[0]]
    units = {name: unit for name in headers if (unit := unit_in_header(name))}
    lines = [rows[k][0] for k in starts] if names else []
    return LaboratoryTable(headers, [*rows[starts[0] + 1 : end]], units, [], blank, lines)


def _headers(cells: Sequence[str], names: set[str]) -> list[str] | None:
    """Return the headers in a row with all these names, without comment characters unless a name has them; or None."""
    if all(cell[:1] in DIGITS for cell in cells):
        return None
    first = cells[0].lstrip(COMMENTED)
    forms = [[first, *cells[1:]] if first else list(cells[1:]), list(cells)]
    return next((headers for headers in forms if names <= _keys(headers)), None)


def _not_found(file: File, rows: Sequence[Row], names: Sequence[str], header: int | None) -> InputError:
    """Return the error for a file without these headers; it lists the headers that look most like them."""
    if not names:
        return InputError(f"{file} has no rows of numbers: give a table, or --separator")
    rows = [(line, [cell for cell in cells if cell.strip("#") and not is_numeral(cell)]) for line, cells in rows]
    line, others = max(
        (row for row in rows if row[1] and header in (None, row[0])),
        key=lambda row: (len(_keys(names) & _keys(row[1])), len(row[1])),
        default=(0, []),
    )
    problem = f"{file} has no line {f'{header} ' if header else ''}with the headers {', '.join(names)}"
    by_number = "columns by their numbers, e.g. axial_strain=#1:%:compression"
    if not others:
        return InputError(f"{problem}, nor any other headers: give {by_number}, or a file with a table")
    lacking = next(name for name in names if _key(name) not in _keys(others))
    coded = "" if problem.isascii() else "; or --encoding, e.g. mac_roman, if its letters look wrong"
    allowed = instead_of(others, lacking)[:400]
    return InputError(f"{problem}: line {line} has no {lacking!r}: give {allowed}; or {by_number}{coded}")


def _group_of_ags4(text: str, file: File, group: str) -> LaboratoryTable:
    """Return a group of an AGS4 file, whose lines have labels. Raises InputError."""
    rows = rows_of(text, ",")
    starts = [k for k, (_, cells) in enumerate(rows) if cells[0] == "GROUP" and len(cells) > 1]
    groups = [rows[k][1][1] for k in starts]
    if not starts:
        raise InputError(f"{file} is no AGS4 file, which has lines GROUP: leave out --ags4, or give another file")
    if groups.count(group) != 1:
        text = f"{file} has the group {group} {groups.count(group)} times: give one of {', '.join(groups)}"
        raise InputError(f"{text}, and repair the file if it has one twice")
    start, *_, end = [*starts[groups.index(group) :][:2], len(rows)][:2]
    labelled: dict[str, list[Row]] = {label: [] for label in ("HEADING", "UNIT", "DATA")}
    for row in rows[start + 1 : end]:
        labelled.setdefault(row[1][0], []).append(row)
    if len(labelled["HEADING"]) != 1 or not labelled["DATA"]:
        number, data = len(labelled["HEADING"]), len(labelled["DATA"])
        text = f"the group {group} of {file} has {number} lines HEADING and {data} lines DATA"
        raise InputError(f"{text}: give another group, or repair the file")
    headers, units = labelled["HEADING"][0][1], [cells for _, cells in labelled["UNIT"][:1]]
    stated = {header: unit or "1" for cells in units for header, unit in zip(headers, cells, strict=False)}
    return LaboratoryTable(headers, labelled["DATA"], stated, [])
