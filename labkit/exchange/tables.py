"""Tables of grains or contacts: CSV, or columns separated by spaces, with or without a header."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas

from labkit.errors import InputError
from labkit.exchange.answers import Answers, names_of
from labkit.exchange.columns import (
    CONTACT,
    GRAIN,
    canonical,
    chosen,
    contact_units,
    contacts_from,
    grain_units,
    grains_from,
)
from labkit.exchange.formats import Format, text_of
from labkit.exchange.packing import ContactList, Packing
from labkit.io.atomic import write_text

BARE = ("x", "y", "z", "size")  # four columns without a header


class Table(Format):
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
        return bool(rows) and any(_numeric(_split(line)) for line in rows[:2])

    def read(self, file: Path, answers: Answers) -> Packing:
        header, values = rows_of(file)
        names = names_of(answers.columns) or header or (BARE if values.shape[1] == len(BARE) else None)
        if names is None:
            raise InputError(f"{file} has {values.shape[1]} columns without names: give --columns, e.g. x,y,z,radius,-")
        columns, spelled = chosen(names, values, {**GRAIN, "size": ("size",)}, file)
        position, size, size_is, identity = grains_from(columns, file)
        return Packing(position, size, size_is, identity, length_unit=grain_units(spelled))

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        header, values = rows_of(file)
        names = names_of(answers.contact_columns) or header
        if names is None:
            raise InputError(f"{file} does not name its columns: give --contact-columns, e.g. id1,id2,fx,fy,fz")
        columns, _ = chosen(names, values, CONTACT, file)
        return contacts_from(columns, file)


def contact_table_units(file: Path) -> float | None:
    """The force unit in the header of a table of contacts, in N; None if it has none."""
    header, _ = rows_of(file)
    spelled = {own: name for name in header or () if (own := canonical(name, CONTACT)) is not None}
    return contact_units(spelled)


def rows_of(file: Path) -> tuple[list[str] | None, np.ndarray]:
    """(names of the columns or None, values (n, k)) of a table. Raises InputError if it is not one."""
    lines = [line for line in text_of(file).splitlines() if line.strip()]
    comments = [line.lstrip("# \t") for line in lines if line.lstrip().startswith("#")]
    lines = [line for line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(f"{file} is empty: give a table of grains or contacts")
    first = _split(lines[0])
    header = None if _numeric(first) else first
    if header is None:
        header = next((names for line in reversed(comments) if (names := _names(line, len(first)))), None)
    else:
        lines = lines[1:]
    separator = next((mark for mark in ",;\t" if lines and mark in lines[0]), r"\s+")
    try:
        frame = pandas.read_csv(io.StringIO("\n".join(lines)), sep=separator, header=None, comment="#", dtype=float)
    except (ValueError, pandas.errors.ParserError) as error:
        raise InputError(f"{file} is not a table of numbers ({str(error).splitlines()[0]})") from None
    if frame.isna().to_numpy().any():
        row = int(np.flatnonzero(frame.isna().to_numpy().any(axis=1))[0])
        raise InputError(f"{file} lacks a number in row {row + 1}: repair the table")
    return header, frame.to_numpy()


def _names(comment: str, count: int) -> list[str] | None:
    """Names of `count` columns in a comment, None if it is another comment."""
    if comment.startswith("format "):  # of YADE's export.text
        names = comment.split()[1].split("_")
    else:
        names = _split(comment)
    known = [name for name in names if canonical(name, {**GRAIN, **CONTACT}) is not None]
    return names if len(names) == count and len(known) >= 2 else None


def _split(line: str) -> list[str]:
    separator = next((mark for mark in ",;\t" if mark in line), None)
    return [word.strip().strip('"') for word in line.split(separator)]


def _numeric(words: Sequence[str]) -> bool:
    try:
        return bool([float(word) for word in words])
    except ValueError:
        return False


def write_table(file: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Writes a CSV file whose header has these names; the numbers keep all their digits."""
    write_text(file, pandas.DataFrame(dict(columns)).to_csv(index=False))
