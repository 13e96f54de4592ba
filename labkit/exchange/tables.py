"""Tables of grains or contacts: CSV, or columns separated by spaces, with or without a header."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pandas

from labkit.errors import InputError
from labkit.exchange.columns import BARE, CONTACT, GRAIN, contacts_from, grains_from
from labkit.exchange.formats import Format, whole_text
from labkit.exchange.packing import Answers, ContactList, Packing, answer_names
from labkit.io.foreign import cells, is_number

MOST_COLUMNS = 1000
FEWEST = 3  # numbers in a row of grains or of contacts


class TextTable(Format):
    """Columns x y z and radius or diameter; a second file of the same kind lists the contacts.

    A header may be a first line of names, in a comment or not (`# x y z r`), or the line `#format x_y_z_r` of YADE's
    export.text. Units in brackets (`x [mm]`) are read. Four columns without a header are x, y, z and a size.
    """

    name = "table"
    description = "CSV or columns separated by spaces"
    endings = (".csv", ".txt", ".dat")

    def recognises(self, file: Path, head: str) -> bool:
        if file.is_dir() or "\0" in head:
            return False
        rows = [line for line in head.splitlines()[:50] if line.strip() and not line.lstrip().startswith("#")]
        return bool(rows) and any(sum(map(is_number, cells(line))) >= FEWEST for line in rows[:2])

    def read(self, file: Path, answers: Answers) -> Packing:
        header, values = table_rows(file)
        bare = BARE if values.shape[1] == len(BARE) else None
        columns, unit = GRAIN.columns(answer_names(answers.columns) or header or bare, values, file)
        return dataclasses.replace(grains_from(columns, file), length_unit=unit)

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        header, values = table_rows(file)
        columns, unit = CONTACT.columns(answer_names(answers.contact_columns) or header, values, file)
        return dataclasses.replace(contacts_from(columns, file), force_unit=unit)


def table_rows(file: Path) -> tuple[list[str] | None, np.ndarray]:
    """Read a table; returns the names of its columns, or None, and values (n, k), NaN for words. Raises InputError.

    A first row that holds no number gives the names.
    """
    lines = [line for line in whole_text(file).splitlines() if line.strip()]
    comments = [line.lstrip("# \t") for line in lines if line.lstrip().startswith("#")]
    lines = [line for line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(f"{file} is empty: give a table of grains or contacts")
    first = cells(lines[0])
    if len(first) > MOST_COLUMNS:
        raise InputError(f"{file} has {len(first)} columns: give a table of at most {MOST_COLUMNS}")
    header = None if any(map(is_number, first)) else first
    if header is None:
        header = next((names for line in reversed(comments) if (names := _names(line, len(first)))), None)
    else:
        lines = lines[1:]
    separator = next((mark for mark in ",;\t" if lines and mark in lines[0]), r"\s+")
    try:
        text = pandas.read_csv(io.StringIO("\n".join(lines)), sep=separator, header=None, comment="#", dtype=str)
    except (ValueError, pandas.errors.ParserError) as error:
        raise InputError(f"{file} is not a table of numbers ({str(error).splitlines()[0]})") from None
    frame = text.apply(pandas.to_numeric, errors="coerce").astype(float)
    lacking = frame.loc[:, frame.notna().any()].isna().to_numpy().any(axis=1)
    if lacking.any() or frame.isna().all(axis=None):
        raise InputError(f"{file} lacks a number in row {int(np.argmax(lacking)) + 1}: repair the table")
    return header, frame.to_numpy()


def _names(comment: str, count: int) -> list[str] | None:
    """Return the names of `count` columns in a comment, or None if it contains other text."""
    if comment.startswith("format "):  # written by YADE's export.text
        names = comment.split()[1].split("_")
    else:
        names = cells(comment)
    known = [name for name in names if GRAIN.canonical(name) or CONTACT.canonical(name)]
    return names if len(names) == count and len(known) >= 2 else None
