"""Columns of a laboratory's table as numbers: every row below the headers is used or named.

Numbers have decimal commas if any of them can only be read so, unless the user gives the decimal mark.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as File

import numpy as np

from labkit.errors import InputError
from labkit.plugins.laboratory_data.layout import Form, LaboratoryTable, cell_of, find_table
from labkit.text.reading import COMMENTS, Row, decimal_marks, is_numeral, is_real, numeral, real, same

SENTINELS = (-99.0, -999.0, -999.25, -9999.0, -99999.0, 9999.0, 99999.0, 999999.0, -1e30, 1e30, -1e32, 1e32)
LARGEST = 1e100  # larger numbers are not measured
Column = tuple[int, str | None]  # index, and unit that its cells may repeat


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


def read_laboratory_columns(file: File, wanted: Mapping[str, str | None], form: Form) -> LaboratoryColumns:
    """Read columns of a table. Raises InputError, which names lines, for what cannot be read.

    Args:
        file: The file.
        wanted: Header, or #1, #2, ... for the number of a column -> unit that cells may repeat, if known.
        form: Form of the table.
    """
    table = find_table(file, [*wanted], [*form.rows], form)
    places = {name: table.place(name, file) for name in (*wanted, *form.rows)}
    stated = {name: table.units.get(table.headers[place]) for name, place in places.items()}
    columns = {name: (places[name], unit or stated[name]) for name, unit in wanted.items()}
    rows, notes = _without_comments(table, columns.values())
    for header, wish in form.rows.items():
        rows = _with_text(rows, places[header], header, wish, file, notes)
    commas = _decimal_commas(file, rows, columns.values(), notes) if form.decimal is None else form.decimal == "comma"
    values, wrong = _values(rows, table, columns, commas, form.thousands)
    last = max((line for line, _ in rows if line not in wrong), default=0)
    prose = [line for line, cells in rows if line in wrong and line > last and not _numbers(cells, columns.values())]
    notes += _named(prose, "below the table, not read")
    bad = {line: text for line, text in wrong.items() if line not in set(prose)}
    if bad and not (last and form.accept):
        raise _unreadable(file, table, bad, last == 0)
    notes += _named([*bad], "left out, cannot be read")
    used = [k for k, (line, _) in enumerate(rows) if line not in wrong]
    if not used:
        raise InputError(f"{file} has no rows of numbers below its headers: give a table with rows")
    others = [k for k, header in enumerate(table.headers) if header and k not in places.values()]
    return LaboratoryColumns(
        dict(zip(wanted, values[used].T, strict=True)),
        np.array([rows[k][0] for k in used], dtype=int),
        {name: unit for name in wanted if (unit := stated[name])},
        {table.headers[k]: [cell_of(rows[row][1], k) for row in used] for k in others},
        notes,
    )


def _numbers(cells: Sequence[str], columns: Iterable[Column]) -> bool:
    """Return True if a cell in one of the columns is a number."""
    return any(is_numeral(cell_of(cells, *column)) for column in columns)


def _named(lines: Sequence[int], what: str) -> list[str]:
    return [f"{_in_words(lines)}: {what}"] if lines else []


def _in_words(lines: Sequence[int]) -> str:
    """Return the numbers of lines in words; of many, the first ones."""
    return f"line{'s' * (len(lines) > 1)} {', '.join(map(str, lines[:5]))}{', ...' * (len(lines) > 5)}"


def _without_comments(table: LaboratoryTable, columns: Iterable[Column]) -> tuple[list[Row], list[str]]:
    """Return the rows that are neither empty nor comments, and notes on these. Raises InputError if there are none."""
    rows, empty, comments = [], [], []
    for line, cells in table.rows:
        comment = cells[0].startswith(COMMENTS) and not _numbers(cells, columns)
        comments.append(line) if comment else rows.append((line, cells)) if any(cells) else empty.append(line)
    if not rows:
        raise InputError(f"the table has no rows below the headers in line {min(table.lines)}: give one with rows")
    return rows, [*table.notes, *_named(empty, "empty"), *_named(comments, "comments")]


def _with_text(rows: list[Row], place: int, header: str, text: str, file: File, notes: list[str]) -> list[Row]:
    """Return the rows that have a text in a column. Raises InputError if there are none."""
    fits = [row for row in rows if _equal(cell_of(row[1], place), text)]
    if not fits:
        others = [cell for cell in dict.fromkeys(cell_of(cells, place) for _, cells in rows) if cell]
        some = ", ".join(others[:10]) + ", ..." * (len(others) > 10)
        raise InputError(f"{file} has no rows with {header}={text}: give a value of the column, {some}")
    notes += [f"{len(rows) - len(fits)} rows have another {header}"] if len(fits) < len(rows) else []
    return fits


def _equal(cell: str, text: str) -> bool:
    """Return True for equal texts or equal numbers: 1 is 1.0."""
    return same(cell) == same(text) or (is_real(cell) and is_real(text) and real(cell) == real(text))


def _decimal_commas(file: File, rows: Sequence[Row], columns: Iterable[Column], notes: list[str]) -> bool:
    """Return True if numbers have decimal commas, with a note. Raises InputError if some have and others have not."""
    lines: dict[str, int] = {}
    for line, cells in rows:
        for column in columns:
            lines.setdefault(cell_of(cells, *column), line)
    marks = decimal_marks(lines)
    places = {mark: f"{word} in line {lines[word]}" for mark, word in marks.items()}
    comma, point, either = (places.get(mark) for mark in (",", ".", "either ,"))
    if comma and point:
        text = f"{comma} has a decimal comma, and {point} has a decimal point"
        raise InputError(f"{file}: {text}: repair the table, or give --decimal comma or --decimal point")
    if either and not comma and not point:
        word = marks["either ,"]
        text = f"{either} may be {numeral(word, True):g} or {numeral(word):g}"
        raise InputError(f"{file}: {text}: give --decimal comma or --decimal point")
    notes += ["decimal commas"] if comma else []
    if other := marks.get("either ." if comma else "either ,"):
        notes.append(f"{other} in line {lines[other]} is read as {numeral(other, bool(comma)):.0f}")
    return bool(comma)


def _values(
    rows: Sequence[Row], table: LaboratoryTable, columns: Mapping[str, Column], commas: bool, thousands: str | None
) -> tuple[np.ndarray, dict[int, str]]:
    """Return the numbers, (row, column), and for each row that cannot be read its line and the reason."""
    values, wrong, width = np.full((len(rows), len(columns)), np.nan), {}, len(table.headers)
    for row, (line, cells) in enumerate(rows):
        if any(cells[width:]) or (table.blank and len(cells) != width):
            wrong[line] = f"has {len(cells)} cells for {width} headers"
            continue
        for column, (header, place) in enumerate(columns.items()):
            cell = cell_of(cells, *place)
            try:
                values[row, column] = numeral(cell.replace(thousands, "") if thousands else cell, commas)
            except ValueError:
                pass
            if not abs(values[row, column]) < LARGEST:
                wrong.setdefault(line, f"has {cell[:40]!r} in {header!r}" if cell else f"has nothing in {header!r}")
    for column, header in enumerate(columns):
        for row in _sentinels(values[:, column]):
            wrong.setdefault(rows[row][0], f"has {values[row, column]:g} in {header!r}, as for a missing value")
    return values, dict(sorted(wrong.items()))


def _sentinels(values: np.ndarray) -> np.ndarray:
    """Return the rows of numbers that stand for a missing value and are far from all others."""
    stands = np.isin(values, SENTINELS)
    others = values[~stands & np.isfinite(values)]
    if not stands.any() or not len(others):
        return np.flatnonzero(stands)
    far = max(np.ptp(others), 0.1 * np.abs(others).max())
    return np.flatnonzero(stands & ((values < others.min() - far) | (values > others.max() + far)))


def _unreadable(file: File, table: LaboratoryTable, wrong: Mapping[int, str], every: bool) -> InputError:
    """Return the error for rows that cannot be read."""
    line, text = next(iter(wrong.items()))
    others = f" (and {_in_words([*wrong][1:])})" if len(wrong) > 1 else ""
    width, advice = len(table.headers), "repair the table"
    if every and text == f"has {width + 1} cells for {width} headers":
        advice = "add a header for every column, such as one for the numbers of rows"
    elif "cells for" in text and not table.blank:
        advice = "put numbers with commas in quotes, or separate the columns by semicolons"
    return InputError(f"{file}: line {line} {text}{others}: {advice}, or leave such rows out with --accept")
