"""Where the table of a laboratory's file is: separator, headers, units in or below them, and rows.

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
from labkit.plugins.laboratory_data.units import is_unit, unit_in_header
from labkit.text.reading import BLANKS, Row, is_numeral, rows_of, same, text_of

MARKS = {"semicolon": ";", "tab": "\t", "bar": "|", "blanks": BLANKS, "blank": None, "comma": ","}
COMMENTED = "#%!/* "  # characters before headers in a comment
DIGITS = "+-.,0123456789"  # no header begins like a number
BY_NUMBER = re.compile(r"#(\d{1,4})")  # a column, counted from 1
FEW = 2  # least number of numbers in the first row of a table without headers
LOOK = 500  # number of rows by which the separator is chosen
MOST_UNITS = 3  # largest number of lines with units and other text below headers
Separator = Literal["semicolon", "tab", "blanks", "blank", "bar", "comma"]


@dataclasses.dataclass(frozen=True)
class Form:
    """What the user says about a table; None for what shows itself.

    Args:
        separator: Name of the mark between columns; `blanks` are two or more, `blank` is any number of them.
        decimal: Decimal mark.
        thousands: Mark between thousands, if it is neither a comma, a point, a blank nor an apostrophe.
        encoding: Encoding of the text.
        header: Number of the line of the headers, from 1, if several lines have them.
        rows: Header -> text; only rows with these texts are read.
        group: Group of an AGS4 file.
        accept: True to leave out rows that cannot be read.
    """

    separator: Separator | None = None
    decimal: Literal["point", "comma"] | None = None
    thousands: str | None = None
    encoding: str | None = None
    header: int | None = None
    rows: Mapping[str, str] = dataclasses.field(default_factory=dict)
    group: str | None = None
    accept: bool = False


def find_table(file: File, wanted: Sequence[str], others: Sequence[str], form: Form) -> LaboratoryTable:
    """Return the table that has the wanted columns and others, without units. Raises InputError if there is none."""
    if form.decimal not in (None, "point", "comma"):
        raise InputError(field="decimal", value=form.decimal, allowed="point or comma")
    text = _text_in(file, form)
    if form.group is None:
        table = _best_table(text, file, [*wanted, *others], form)
    else:
        table = _ags4(text, file, form.group)
    return _below_units(table, [table.place(name, file) for name in wanted])


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


@dataclasses.dataclass(frozen=True)
class LaboratoryTable:
    """One table of a file.

    Args:
        lines: Numbers of the lines that have its headers, from 1, and the text above each; 0 without headers.
        headers: Headers.
        rows: Rows below the first of these lines.
        units: Header -> unit.
        notes: What was left out.
        blank: True if blanks separate the columns, so that no cell can be empty.
    """

    lines: dict[int, str]
    headers: list[str]
    rows: list[Row]
    units: dict[str, str]
    notes: list[str]
    blank: bool = False

    def places(self, wanted: str) -> list[int]:
        """Return the indices of the columns with this header, or of the column with this number."""
        number = int(wanted[1:]) if BY_NUMBER.fullmatch(wanted) else 0
        fits = [k for k, header in enumerate(self.headers) if key(header) == key(wanted)]
        return fits or [number - 1] * (1 <= number <= len(self.headers))

    def place(self, wanted: str, file: File) -> int:
        """Return the index of the only such column. Raises InputError."""
        places = self.places(wanted)
        if len(places) == 1:
            return places[0]
        if not places:
            headers = ", or one of " + ", ".join(filter(None, self.headers))[:400] if min(self.lines) else ""
            raise InputError(f"{file} has no column {wanted}: give #1 to #{len(self.headers)}{headers}")
        numbers = [f"#{k + 1}" for k in places]
        text = f"{file} has the header {wanted!r} above the columns {' and '.join(numbers)}"
        raise InputError(f"{text}: give the number of a column instead, e.g. {numbers[0]}")


def cell_of(cells: Sequence[str], place: int, unit: str | None = None) -> str:
    """Return a cell without the unit that it may repeat, such as 12.5 %; empty if the row is too short."""
    cell = cells[place] if place < len(cells) else ""
    return cell.removesuffix(unit).strip() if unit and unit[-1] not in "-.,0123456789" else cell


@functools.lru_cache(10_000)
def key(header: str) -> str:
    """Normalise a header, so that headers that look the same are equal, also where a blank stands before a bracket."""
    return re.sub(r" (?=[\[(])", "", same(header))


def _best_table(text: str, file: File, wanted: Sequence[str], form: Form) -> LaboratoryTable:
    """Return the table with the wanted headers, or with columns of these numbers. Raises InputError."""
    if form.separator not in (None, *MARKS):
        raise InputError(field="separator", value=form.separator, allowed=f"one of {', '.join(MARKS)}")
    marks = [MARKS[form.separator]] if form.separator else [*MARKS.values()]
    rows = {mark: rows_of(text, mark) for mark in marks if mark in (None, BLANKS) or mark in text}
    if not rows:
        raise InputError(f"does not stand in {file}", field="separator", value=form.separator, allowed="another one")
    tables = [table for mark in rows if (table := _below_headers(rows[mark], wanted, form.header, mark))]
    if not tables:
        raise _not_found(file, rows, wanted, form.header)
    best = max(tables, key=lambda table: _fit(table, wanted))
    if len(best.lines) > 1 and not form.header and not form.accept:
        lines = " and ".join(f"{line}{above and f' (below {above!r})'}" for line, above in best.lines.items())
        text = f"{file} has these headers in the lines {lines}"
        raise InputError(f"{text}: give --header with one of them, or --accept if the table only repeats them")
    return best


def _below_headers(
    rows: Sequence[Row], wanted: Sequence[str], header: int | None, mark: str | None
) -> LaboratoryTable | None:
    """Return the table below the headers, or from the first row of numbers if no headers are wanted; None if none."""
    names = _keys(name for name in wanted if not BY_NUMBER.fullmatch(name))
    blank = mark in (None, BLANKS)
    if not names and not header:
        first = next((k for k, (_, row) in enumerate(rows) if sum(map(is_numeral, row)) >= FEW), len(rows))
        numbered = [f"#{k + 1}" for k in range(max((len(cells) for _, cells in rows[first:]), default=0))]
        notes = [f"{first} lines above the first row of numbers are not read"] if first else []
        return LaboratoryTable({0: ""}, numbered, [*rows[first:]], {}, notes, blank) if numbered else None
    heads = {k: cells for k, row in enumerate(rows) if (cells := _headers(row[1], names)) is not None}
    starts = [k for k in heads if header in (None, rows[k][0])]
    if not starts:
        return None
    end = next((k for k in heads if k > starts[0]), None) if header and names else None
    lines = {rows[k][0]: " ".join(filter(None, rows[k - 1][1]))[:40] if k else "" for k in starts}
    headers = heads[starts[0]]
    units = {name: unit for name in headers if (unit := unit_in_header(name))}
    return LaboratoryTable(
        lines if names else {header or 0: ""}, headers, [*rows[starts[0] + 1 : end]], units, [], blank
    )


def _headers(cells: Sequence[str], names: set[str]) -> list[str] | None:
    """Return the headers in a row with all these names, without comment characters unless a name has them; or None."""
    if all(cell[:1] in DIGITS for cell in cells):
        return None
    first = cells[0].lstrip(COMMENTED)
    forms = [[first, *cells[1:]] if first else list(cells[1:]), list(cells)]
    return next((headers for headers in forms if names <= _keys(headers)), None)


def _fit(table: LaboratoryTable, wanted: Sequence[str]) -> int:
    """Return the number of numbers in the wanted columns, in rows that are not wider than the headers."""
    places, width = [place for name in wanted for place in table.places(name)[:1]], len(table.headers)
    rows = (cells for _, cells in table.rows[:LOOK] if not any(cells[width:]) and len(cells) >= width * table.blank)
    return sum(is_numeral(cell_of(cells, place).split(" ")[0]) for cells in rows for place in places)


def _not_found(
    file: File, forms: Mapping[str | None, Sequence[Row]], wanted: Sequence[str], header: int | None
) -> InputError:
    """Return the error for a file without these headers; it lists the headers that look most like them."""
    names = [name for name in wanted if not BY_NUMBER.fullmatch(name)]
    if not names:
        return InputError(f"{file} has no rows of numbers: give a table, or --separator")
    lines = [
        (line, [cell for cell in cells if cell.strip("#") and not is_numeral(cell)], mark)
        for mark, rows in forms.items()
        for line, cells in rows[:LOOK]
        if header in (None, line)
    ]
    lines = [line for line in lines if line[1]]
    problem = f"{file} has no line {f'{header} ' if header else ''}with the headers {', '.join(names)}"
    by_number = "columns by their numbers, e.g. axial_strain=#1:%:compression"
    if not lines:
        return InputError(f"{problem}, nor any other headers: give {by_number}, or a file with a table")
    line, others, _ = max(lines, key=lambda line: (len(_keys(names) & _keys(line[1])), len(line[1]) if line[2] else 1))
    lacking = next(name for name in names if key(name) not in _keys(others))
    coded = "" if problem.isascii() else "; or --encoding, e.g. mac_roman, if its letters look wrong"
    allowed = instead_of(others, lacking)[:400]
    return InputError(f"{problem}: line {line} has no {lacking!r}: give {allowed}; or {by_number}{coded}")


def _keys(headers: Iterable[str]) -> set[str]:
    return set(map(key, headers))


def _ags4(text: str, file: File, group: str) -> LaboratoryTable:
    """Return a group of an AGS4 file, whose lines have labels. Raises InputError."""
    rows = rows_of(text, ",")
    if any(cells[0].startswith("**") for _, cells in rows):
        raise InputError(f"{file} is an AGS 3 file: convert it to AGS 4, or export its table as CSV")
    starts = [k for k, (_, cells) in enumerate(rows) if cells[0] == "GROUP" and len(cells) > 1]
    names = [rows[k][1][1] for k in starts]
    if not starts:
        raise InputError(f"{file} is no AGS4 file, which has lines GROUP: leave out --ags4, or give another file")
    if names.count(group) != 1:
        problem = f"has the group {group} {names.count(group)} times: repair the file"
        problem = problem if group in names else f"has no group {group}: give one of {', '.join(names)}"
        raise InputError(f"{file} {problem}")
    start, *_, end = [*starts[names.index(group) :][:2], len(rows)][:2]
    labelled: dict[str, list[Row]] = {label: [] for label in ("HEADING", "UNIT", "DATA")}
    for row in rows[start + 1 : end]:
        labelled.setdefault(row[1][0], []).append(row)
    if len(labelled["HEADING"]) != 1 or not labelled["DATA"]:
        number, data = len(labelled["HEADING"]), len(labelled["DATA"])
        text = f"the group {group} of {file} has {number} lines HEADING and {data} lines DATA"
        raise InputError(f"{text}: give another group, or repair the file")
    line, headers = labelled["HEADING"][0]
    units = zip(headers, *(cells for _, cells in labelled["UNIT"][:1]), strict=False) if labelled["UNIT"] else ()
    return LaboratoryTable({line: ""}, headers, labelled["DATA"], {header: unit or "1" for header, unit in units}, [])


def _below_units(table: LaboratoryTable, places: Sequence[int]) -> LaboratoryTable:
    """Return the table without the rows of units and of other text under its headers."""
    units, notes, rows = dict(table.units), list(table.notes), list(table.rows)
    for line, cells in table.rows[:MOST_UNITS]:
        if any(is_numeral(cell_of(cells, place)) for place in places) or not any(cells):
            break
        below = {header: cell for header, cell in zip(table.headers, cells, strict=False) if is_unit(cell)}
        units |= below
        notes += [] if below else [f"line {line} below the headers is not read ({' '.join(cells)[:40]})"]
        rows.pop(0)
    return dataclasses.replace(table, rows=rows, units=units, notes=notes)
