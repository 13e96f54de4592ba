"""Tables of grains or contacts: CSV, or columns separated by spaces, with or without a header."""

from __future__ import annotations

import dataclasses
import re
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.columns import BARE, CONTACT, GRAIN, WALL, contacts_from, grains_from
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format
from labkit.plugins.exchange.packing import Answers, Packing, answer_names, require_count
from labkit.text.reading import LONGEST, SEPARATORS, Sheet, is_real, read_table, real, split, text_of

STATED = re.compile(r"(?i)\b(time[ _]?step|step|time)\b[ \t]{0,9}[=:]?[ \t]{0,9}([-+.\d][\w.+-]*)(?![:\w])")
FEWEST = 3  # least number of columns in a table of grains or contacts
WALLS = "contacts with walls are left out"
MOST_SHORT = 0.2  # fraction of the rows up to which shorter rows are of another kind


class TextTable(Format):
    """A table with the columns x y z and radius or diameter; a second table lists the contacts.

    A header is a first line of names, which may be a comment (`# x y z r`), or the line `#format x_y_z_r` from YADE's
    export.text. Units in brackets (`x [mm]`) are read. Four columns without a header are x, y, z and a size.
    """

    name = "table"
    description = "CSV or columns separated by spaces"
    endings = (".csv", ".txt", ".dat")

    def recognises(self, file: Path, head: str) -> bool:
        if file.is_dir() or "\0" in head:
            return False
        try:
            read_table(head, file, FEWEST)
        except InputError:
            return False
        return True

    def read(self, file: Path, answers: Answers) -> Packing:
        return grains_in(text_of(file), file, answers, BARE)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        table = read_table(text_of(file), file, FEWEST)
        names = answer_names(answers.contact_columns) or _names_of(table)
        grains = [not any(not is_real(cell) and WALL.search(cell) for cell in row) for row in table.rows]
        notes = [f"{len(grains) - sum(grains)} {WALLS}"] if not all(grains) else []
        at, notes, table = _stated(table), [*table.notes, *notes], table.where(grains)
        columns, unit = CONTACT.columns(names, table.numbers(file), file, answers.newton)
        _require_complete(columns, table, file)
        return dataclasses.replace(contacts_from(columns, file), force_unit=unit, at=at, notes=tuple(notes))


def grains_in(text: str, file: Path, answers: Answers, bare: Sequence[str]) -> Packing:
    """Read the grains of a table; `bare` names its first columns if neither the file nor the user does."""
    table = read_table(text, file, FEWEST)
    first = text.lstrip().partition("\n")[0].strip()
    if table.titles and first.isdecimal() and len(first) < LONGEST:  # as in XYZ: the number of grains, and a comment
        require_count(file, int(first), len(table.rows), "grains")
    _require_even(table, file)
    names = answer_names(answers.columns) or _names_of(table)
    if names is None and not table.titles and len(BARE) <= len(table.rows[0]) <= len(bare):
        names = bare[: len(table.rows[0])]
    columns, unit = GRAIN.columns(names, table.numbers(file), file, answers.metre)
    _require_complete(columns, table, file)
    return dataclasses.replace(grains_from(columns, file), length_unit=unit, at=_stated(table), notes=table.notes)


def _require_even(table: Sheet, file: Path) -> None:
    """Raise InputError if a few rows lack two or more cells at their end, as the first line of a further frame does."""
    filled = [max((number for number, cell in enumerate(row, 1) if cell), default=0) for row in table.rows]
    usual = statistics.mode(filled)
    short = [row for row, cells in enumerate(filled) if cells < usual - 1]
    if short and len(short) < MOST_SHORT * len(filled):
        first = short[0]
        raise InputError(
            f"{file} has {filled[first]} cells in line {table.lines[first]}, and {usual} in other lines: give a file "
            "with one frame, or repair the table"
        )


def _require_complete(columns: Mapping[str, np.ndarray], table: Sheet, file: Path) -> None:
    """Raise InputError if a number is missing in a column that is used."""
    for name, column in columns.items():
        if name not in ("body", "mol") and np.isnan(column).any():
            row = int(np.argmax(np.isnan(column)))
            cells, line = ", ".join(table.rows[row])[:60], table.lines[row]
            raise InputError(f"{file} lacks a number in line {line} ({cells}), column {name}: repair the table")


def _stated(table: Sheet) -> dict[str, float]:
    """Return the step and the time that the comments of a table state."""
    matches = [match for match in map(STATED.search, table.comments) if match and is_real(match[2])]
    return {("time" if match[1].lower() == "time" else "step"): real(match[2]) for match in matches}


def _names_of(table: Sheet) -> list[str] | None:
    """Return the names of the columns from the line above the rows, or from the last comment that contains names."""
    if table.names is not None:
        return table.names
    return next((names for text in reversed(table.comments) if (names := _names(text, len(table.rows[0])))), None)


def _names(comment: str, count: int) -> list[str] | None:
    """Return the names of `count` columns in a comment, or None if it contains other text."""
    if comment.startswith("format "):  # written by YADE's export.text
        names = comment.split()[1].split("_")
    else:
        marks = (mark for mark in SEPARATORS if mark is None or mark in comment)
        names = split(comment, next(marks))
    understood = [name for name in names if GRAIN.canonical(name) or CONTACT.canonical(name)]
    return names if len(names) == count and len(understood) >= 2 else None
