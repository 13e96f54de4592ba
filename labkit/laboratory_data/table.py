"""Columns of a laboratory's table as numbers: every row below the headers is used or named."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path as File
from typing import Literal

import numpy as np

from labkit.errors import InputError
from labkit.io.text import COMMENTS, decimal_marks, is_numeral, is_real, numeral, real, same
from labkit.laboratory_data.layout import MISSING, LaboratoryTable, Row, blocks_in, lines_in_words

SENTINELS = (-99.0, -999.0, -999.25, -9999.0, -99999.0, 9999.0, 99999.0, 999999.0, -1e30, 1e30, -1e32, 1e32)
NEAR = 0.1  # a number that differs less from a neighbour, relative to it, was measured


@dataclasses.dataclass(frozen=True)
class Choice:
    """Which rows of a file are wanted.

    Args:
        rows: Header -> text; only rows with these texts are read.
        group: Group of an AGS4 file.
        block: Table of the file, counted from 1, or words above it, or "all", if there are several tables.
        decimal: Decimal mark, for numbers that do not show it.
        accept: True to leave out rows that cannot be read.
    """

    rows: Mapping[str, str] = dataclasses.field(default_factory=dict)
    group: str | None = None
    block: int | str | None = None
    decimal: Literal["point", "comma"] | None = None
    accept: bool = False


@dataclasses.dataclass(frozen=True, eq=False)
class LaboratoryColumns:
    """The columns of a table.

    Args:
        values: Header -> numbers, (n,).
        lines: Number of the line of each row in the file, from 1, (n,).
        units: Header -> unit, where the file states it.
        texts: Headers of the other columns -> their cells, (n,).
        tables: Title of each table that was read -> the index of its first row.
        notes: What was left out or assumed.
    """

    values: dict[str, np.ndarray]
    lines: np.ndarray
    units: dict[str, str]
    texts: dict[str, list[str]]
    tables: dict[str, int]
    notes: list[str]


def read_laboratory_columns(file: File, wanted: Mapping[str, str | None], choice: Choice) -> LaboratoryColumns:
    """Read columns of a table. Raises InputError, which names lines, for what cannot be read.

    Args:
        file: The file.
        wanted: Header, or #1, #2, ... for the number of a column -> unit that cells may repeat, if known.
        choice: Which rows are wanted.
    """
    blocks = _chosen(blocks_in(file, [*wanted, *choice.rows], choice.group), file, choice.block)
    first = blocks[0]
    units = {one: unit or first.units.get(first.headers[first.place(one)]) for one, unit in wanted.items()}
    notes: list[str] = []
    rows: list[Row] = []
    tables: dict[str, int] = {}
    for block in blocks:
        notes += block.notes
        tables[block.title] = block.line
        rows += block.rows
    if not rows:
        raise InputError(f"{file} has no rows below the headers in line {first.line}: give a table with rows")
    rows = _without_comments(rows, notes)
    for header, text in choice.rows.items():
        rows = _with_text(rows, first.place(header), header, text, file, notes)
    commas = choice.decimal == "comma"
    if choice.decimal is None:
        places = {first.place(one): unit for one, unit in units.items()}
        commas = _decimal_commas(file, _first_lines(rows, places), notes)
    reader = _Reader(file, first, units, choice, commas)
    values, kept = reader.numbers(rows, notes)
    numbers = [line for line, _ in kept]
    starts = {title: sum(line < above for line in numbers) for title, above in tables.items()}
    used = [*reader.places, *map(first.place, choice.rows)]
    others = [k for k, header in enumerate(first.headers) if header and k not in used]
    return LaboratoryColumns(
        dict(zip(wanted, values.T, strict=True)),
        np.array([line for line, _ in kept], dtype=int),
        {one: unit for one in wanted if (unit := first.units.get(first.headers[first.place(one)]))},
        {first.headers[k]: [cells[k] if k < len(cells) else "" for _, cells in kept] for k in others},
        starts,
        notes,
    )


def _chosen(blocks: list[LaboratoryTable], file: File, wanted: int | str | None) -> list[LaboratoryTable]:
    """Return the tables to read: the wanted one, or all. Raises InputError."""
    if len(blocks) == 1 and wanted in (None, "all", 1, "1"):
        return blocks
    named = ", ".join(f"{k} ({one.title})" for k, one in enumerate(blocks, 1))
    if wanted is None or wanted == "all":
        if any(one.headers != blocks[0].headers for one in blocks):
            raise InputError(f"{file} has several tables with these headers: give --block, one of {named}")
        return blocks
    fits = blocks[int(wanted) - 1 :][:1] if str(wanted).isdecimal() and int(wanted) > 0 else []
    fits = fits or [one for one in blocks if any(same(str(wanted)) in same(line) for line in one.above)]
    if len(fits) != 1:
        raise InputError("is not a table of the file", field="block", value=wanted, allowed=f"one of {named}, or all")
    return fits


def _without_comments(rows: list[Row], notes: list[str]) -> list[Row]:
    """Return the rows that are no comments, and note the comments."""
    comments = [line for line, cells in rows if cells[0].startswith(COMMENTS) and not MISSING.fullmatch(cells[0])]
    notes += [f"{lines_in_words(comments)}: comments"] if comments else []
    return [row for row in rows if row[0] not in set(comments)] if comments else rows


def _with_text(rows: list[Row], place: int, header: str, text: str, file: File, notes: list[str]) -> list[Row]:
    """Return the rows that have a text in a column. Raises InputError if there are none."""
    cells = [row[place] if place < len(row) else "" for _, row in rows]
    kept = [row for row, cell in zip(rows, cells, strict=True) if _equal(cell, text)]
    if not kept:
        others = [cell for cell in dict.fromkeys(cells) if cell]
        some = ", ".join(others[:10]) + ", ..." * (len(others) > 10)
        raise InputError(f"{file} has no rows with {header}={text}: give a value of the column, {some}")
    notes += [f"{len(rows) - len(kept)} rows have another {header}"] if len(kept) < len(rows) else []
    return kept


def _equal(cell: str, text: str) -> bool:
    """Return True for equal texts or equal numbers: 1 is 1.0."""
    return same(cell) == same(text) or (is_real(cell) and is_real(text) and real(cell) == real(text))


def _decimal_commas(file: File, lines: Mapping[str, int], notes: list[str]) -> bool:
    """Return True if numbers have decimal commas, with a note. Raises InputError if some have and others have not.

    Args:
        file: The file, for messages.
        lines: Cell -> number of its first line.
        notes: Notes, to which some may be added.
    """
    marks = decimal_marks(lines)
    places = {mark: f"{word} in line {lines[word]}" for mark, word in marks.items()}
    comma, point, either = (places.get(mark) for mark in (",", ".", "either ,"))
    if comma and point:
        text = f"{comma} has a decimal comma, and {point} has a decimal point"
        raise InputError(f"{file}: {text}: repair the table, or give --decimal comma or --decimal point")
    if either and not comma and not point:
        number = marks["either ,"]
        text = f"{either} may be {numeral(number, True):g} or {numeral(number):g}"
        raise InputError(f"{file}: {text}: give --decimal comma or --decimal point")
    notes += ["decimal commas"] if comma else []
    if other := marks.get("either ." if comma else "either ,"):
        notes.append(f"{other} in line {lines[other]} is read as {numeral(other, bool(comma)):.0f}")
    return bool(comma)


def _first_lines(rows: Sequence[Row], places: Mapping[int, str | None]) -> dict[str, int]:
    """Return the cells of columns, index -> unit, and the number of the first line of each."""
    lines: dict[str, int] = {}
    for line, cells in rows:
        for place, unit in places.items():
            if place < len(cells):
                lines.setdefault(_without_unit(cells[place], unit), line)
    return lines


@dataclasses.dataclass(frozen=True)
class _Reader:
    """Converts rows of a table to numbers."""

    file: File
    block: LaboratoryTable
    wanted: Mapping[str, str | None]
    choice: Choice
    commas: bool

    @property
    def places(self) -> list[int]:
        """Indices of the wanted columns."""
        return [self.block.place(one) for one in self.wanted]

    def numbers(self, rows: Sequence[Row], notes: list[str]) -> tuple[np.ndarray, list[Row]]:
        """Return the numbers, (row, column), and their rows. Raises InputError for rows that cannot be read."""
        places, values, kept, bad = self.places, [], [], {}
        for line, cells in rows:
            try:
                values.append(self._row(cells, places))
                kept.append((line, cells))
            except ValueError as error:
                bad[line] = str(error)
        last = kept[-1][0] if kept else 0
        text = {line for line, cells in rows if line in bad and line > last and not self._has_numbers(cells, places)}
        notes += [f"{lines_in_words(sorted(text))} below the table: not read"] if text else []
        found = np.array(values, dtype=float).reshape(len(kept), len(places))
        for row, column in _sentinels(found):
            name = [*self.wanted][column]
            bad.setdefault(kept[row][0], f"has {found[row, column]:g} in {name!r}, as for a missing value")
        wrong = {line: bad[line] for line in sorted(bad) if line not in text}
        self._require_accepted(wrong, len(kept))
        notes += [f"{lines_in_words([*wrong])}: left out, cannot be read"] if wrong else []
        keep = [k for k, (line, _) in enumerate(kept) if line not in wrong]
        if not keep:
            raise InputError(f"{self.file} has no rows of numbers below its headers: give a table with rows")
        return found[keep], [kept[k] for k in keep]

    def _row(self, cells: Sequence[str], places: Sequence[int]) -> list[float]:
        """Return the numbers of a row. Raises ValueError, with the reason, if there is another text."""
        width = len(self.block.headers)
        if any(cells[width:]) or (self.block.blanks and len(cells) != width):
            raise ValueError(f"has {len(cells)} cells for {width} headers")
        found = []
        for place, (header, unit) in zip(places, self.wanted.items(), strict=True):
            cell = cells[place] if place < len(cells) else ""
            try:
                number = numeral(_without_unit(cell, unit), self.commas)
            except ValueError:
                number = np.nan
            if not np.isfinite(number):
                raise ValueError(f"has {cell[:40]!r} in {header!r}" if cell else f"has nothing in {header!r}")
            found.append(number)
        return found

    def _has_numbers(self, cells: Sequence[str], places: Sequence[int]) -> bool:
        """Return True if a wanted cell is a number."""
        return any(is_numeral(cells[k]) or bool(MISSING.fullmatch(cells[k])) for k in places if k < len(cells))

    def _require_accepted(self, wrong: Mapping[int, str], kept: int) -> None:
        """Raise InputError for rows that cannot be read, unless the user accepts that they are left out."""
        if not wrong or (self.choice.accept and kept):
            return
        line, text = next(iter(wrong.items()))
        others = f" (and {lines_in_words([*wrong][1:])})" if len(wrong) > 1 else ""
        advice = "repair the table"
        if "cells for" in text and not self.block.blanks:
            advice = "put numbers with commas in quotes, or separate the columns by semicolons"
        if kept == 0 and text == f"has {len(self.block.headers) + 1} cells for {len(self.block.headers)} headers":
            advice = "add a header for every column, such as one for the numbers of rows"
        raise InputError(f"{self.file}: line {line} {text}{others}: {advice}, or leave such rows out with --accept")


def _without_unit(cell: str, unit: str | None) -> str:
    """Return a cell without the unit that it may repeat, such as 12.5 %."""
    return cell.removesuffix(unit).strip() if unit and unit[-1] not in "-.,0123456789" else cell.strip()


def _sentinels(values: np.ndarray) -> list[tuple[int, int]]:
    """Return row and column of numbers that stand for a missing value and are not next to a similar number."""
    found = []
    for row, column in np.argwhere(np.isin(values, SENTINELS)):
        others = values[[k for k in (row - 1, row + 1) if 0 <= k < len(values)], column]
        others = others[~np.isin(others, SENTINELS)]
        if not (np.abs(others - values[row, column]) <= NEAR * abs(values[row, column])).any():
            found.append((int(row), int(column)))
    return found
