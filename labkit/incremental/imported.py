"""*ImportFile: increments that are the differences between the rows of a table in another file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.incremental.source import REAL, Line, Source, shortened

MOST_ROWS = 20_000
MOST_COLUMNS = 100


def imported_rows(source: Source, line: Line, name: str, columns: int, increments: int) -> np.ndarray:
    """Read the first `increments` + 1 rows of a table in the folder of the test file, (n, columns).

    Lines before the first one that starts with a number are skipped. Raises InputError with the line that names the
    file, or with the line of the table.
    """
    if not name or "\0" in name:
        raise line.error("*ImportFile names no file: write *ImportFile FILE | COLUMNS")
    file = source.file.parent / Path(name)
    if not file.is_file():
        raise line.error(f"the file {shortened(name)} does not exist: give one in {file.parent}")
    try:
        rows = _rows(Source(file), columns, min(increments, MOST_ROWS) + 1)
    except InputError as error:
        raise line.error(str(error)) from None
    if len(rows) < 2:
        raise line.error(f"{file} has {len(rows)} rows of numbers: give at least two")
    return np.array(rows)


def _rows(source: Source, columns: int, most: int) -> list[list[float]]:
    rows: list[list[float]] = []
    while len(rows) < most and (line := source.next()) is not None:
        if rows or REAL.match(line.first):
            rows.append(line.reals(columns, f"{columns} columns"))
    return rows
