"""Columns of a laboratory's table as numbers: every row below the headers is used or named.

Numbers have decimal commas if any of them can only be read so, unless the user gives the decimal mark.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path as File

import numpy as np

from labkit.errors import InputError
from labkit.plugins.laboratory_data.layout import Form, LaboratoryTable, cell_of, find_table
from labkit.plugins.laboratory_data.units import is_unit
from labkit.text.reading import COMMENTS, Row, decimal_marks, is_numeral, number_or_nan, numeral, same

MOST_UNITS = 3  # largest number of lines with units and other text below headers
LARGEST = 1e100  # larger numbers are not measured


@dataclasses.dataclass(frozen=True, eq=False)
class LaboratoryColumns:
    """The columns of a table.

    Args:
        values: Header -> numbers, (n,).
        lines: Number of the line of each row in the file, from 1, (n,).
        units: Header -> unit, where the file states it.
        texts: Headers of the other columns -> their cells, (n,).
        notes: What was left out or assumed.
    """

    values: dict[str, np.ndarray]
    lines: np.ndarray
    units: dict[str, str]
    texts: dict[str, list[str]]
    notes: list[str]


def read_laboratory_columns(file: File, names: Collection[str], form: Form) -> LaboratoryColumns:
    """Read columns of a table. Raises InputError, which names lines, for what cannot be read.

    Args:
        file: The file.
        names: Headers, or #1, #2, ... for the number of a column.
        form: Form of the table.
    """
    if form.decimal not in (None, "point", "comma"):
        raise InputError(field="decimal", value=form.decimal, allowed="point or comma")
    every = [*names, *form.rows]
    table = find_table(file, every, form)
    places = {name: table.place(name, file) for name in every}
    columns = {name: places[name] for name in names}
    table = _without_units_and_comments(table, [*columns.values()], file)
    rows, notes = table.rows, list(table.notes)
    for header, text in form.rows.items():
        rows = _rows_with(rows, places[header], header, text, file, notes)
    commas = form.decimal == "comma" if form.decimal else _decimal_commas(file, rows, [*columns.values()], notes)
    values, wrong = _values(rows, table, columns, commas)
    last = max((line for line, _ in rows if line not in wrong), default=0)
    numbers = {line for line, cells in rows if any(is_numeral(cell_of(cells, k)) for k in columns.values())}
    below = {line for line, _ in rows if line > last > 0} - numbers
    bad = {line: text for line, text in wrong.items() if line not in below}
    if bad and not (last and form.accept):
        raise _unreadable(file, bad)
    notes += _named(sorted(below), "below the table, not read") + _named([*bad], "left out, cannot be read")
    used = [k for k, (line, _) in enumerate(rows) if line not in wrong]
    others = [k for k, header in enumerate(table.headers) if header and k not in places.values()]
    return LaboratoryColumns(
        dict(zip(names, values[used].T, strict=True)),
        np.array([rows[k][0] for k in used], dtype=int),
        {name: unit for name, k in columns.items() if (unit := table.units.get(table.headers[k]))},
        {table.headers[k]: [cell_of(rows[row][1], k) for row in used] for k in others},
        notes,
    )


def _without_units_and_comments(table: LaboratoryTable, places: Sequence[int], file: File) -> LaboratoryTable:
    """Return the table without the lines of units below its headers, empty rows and comments. Raises InputError."""
    units, notes, rows = dict(table.units), list(table.notes), list(table.rows)

    def has_numbers(cells: Sequence[str]) -> bool:
        return any(is_numeral(cell_of(cells, place)) for place in places)

    for line, cells in table.rows[:MOST_UNITS]:
        if has_numbers(cells) or not any(cells):
            break
        below = {header: cell for header, cell in zip(table.headers, cells, strict=False) if is_unit(cell)}
        units |= below
        notes += [] if below else [f"line {line} below the headers is not read ({' '.join(cells)[:40]})"]
        rows.pop(0)
    empty = [line for line, cells in rows if not any(cells)]
    comments = [line for line, cells in rows if cells[0].startswith(COMMENTS) and not has_numbers(cells)]
    rows = [row for row in rows if row[0] not in {*empty, *comments}]
    if not rows:
        raise InputError(f"{file} has no rows below its headers: give a table with rows")
    notes += _named(empty, "empty") + _named(comments, "comments")
    return dataclasses.replace(table, rows=rows, units=units, notes=notes)


def _named(lines: Sequence[int], what: str) -> list[str]:
    return [f"{_in_words(lines)}: {what}"] if lines else []


def _in_words(lines: Sequence[int]) -> str:
    """Return the numbers of lines in words; of many, the first ones."""
    return f"line{'s' * (len(lines) > 1)} {', '.join(map(str, lines[:5]))}{', ...' * (len(lines) > 5)}"


def _rows_with(rows: list[Row], place: int, header: str, text: str, file: File, notes: list[str]) -> list[Row]:
    """Return the rows that have a text, or an equal number, in a column. Raises InputError if there are none."""
    number = number_or_nan(text)
    fits = [row for row in rows if same(cell := cell_of(row[1], place)) == same(text) or number_or_nan(cell) == number]
    if not fits:
        others = [cell for cell in dict.fromkeys(cell_of(cells, place) for _, cells in rows) if cell]
        some = ", ".join(others[:10]) + ", ..." * (len(others) > 10)
        raise InputError(f"{file} has no rows with {header}={text}: give a value of the column, {some}")
    notes += [f"{len(rows) - len(fits)} rows have another {header}"] if len(fits) < len(rows) else []
    return fits


def _decimal_commas(file: File, rows: Sequence[Row], places: Iterable[int], notes: list[str]) -> bool:
    """Return True if numbers have decimal commas, with a note. Raises InputError if some have and others have not."""
    lines: dict[str, int] = {}
    for line, cells in rows:
        for place in places:
            lines.setdefault(cell_of(cells, place), line)
    marks = decimal_marks(lines)
    said = {mark: f"{word} in line {lines[word]}" for mark, word in marks.items()}
    comma, point, either = (said.get(mark, "") for mark in (",", ".", "either ,"))
    if comma and point:
        text = f"{comma} has a decimal comma, and {point} has a decimal point"
        raise InputError(f"{file}: {text}: repair the table, or give --decimal comma or --decimal point")
    if either and not comma and not point:
        word = marks["either ,"]
        text = f"{either} may be {numeral(word, True):g} or {numeral(word):g}"
        raise InputError(f"{file}: {text}: give --decimal comma or --decimal point")
    notes += ["decimal commas"] if comma else []
    if other := marks.get(mark := "either ." if comma else "either ,"):
        notes.append(f"{said[mark]} is read as {numeral(other, bool(comma)):.0f}")
    return bool(comma)


def _values(
    rows: Sequence[Row], table: LaboratoryTable, columns: Mapping[str, int], commas: bool
) -> tuple[np.ndarray, dict[int, str]]:
    """Return the numbers, (row, column), and for each row that cannot be read its line and the reason."""
    values, wrong, width = np.full((len(rows), len(columns)), np.nan), dict[int, str](), len(table.headers)
    for row, (line, cells) in enumerate(rows):
        if any(cells[width:]) or (table.blank and len(cells) != width):
            wrong[line] = f"has {len(cells)} cells for {width} headers"
            continue
        for column, (header, place) in enumerate(columns.items()):
            cell = cell_of(cells, place)
            values[row, column] = number_or_nan(cell, commas)
            if not abs(values[row, column]) < LARGEST:
                wrong.setdefault(line, f"has {cell[:40]!r} in {header!r}" if cell else f"has nothing in {header!r}")
    return values, wrong


def _unreadable(file: File, wrong: Mapping[int, str]) -> InputError:
    """Return the error for rows that cannot be read."""
    line, text = next(iter(wrong.items()))
    others = f" (and {_in_words([*wrong][1:])})" if len(wrong) > 1 else ""
    advice = "put numbers with commas in quotes, or add a header for every column" * ("cells for" in text)
    return InputError(f"{file}: line {line} {text}{others}: {advice or 'repair the table'}, or leave out: --accept")
