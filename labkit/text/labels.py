"""Labels of values that a campaign file lists, which become parts of the names of specimens and runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labkit.text.document import Fields


def label_of(name: str, value: object, values: Sequence[object]) -> str:
    """Return the part of a name that a listed value adds: p300kPa, void_ratio0.6, law-hertz_mindlin, or grading1."""
    if name == "pressure" and isinstance(value, float):
        return f"p{value / 1e3:g}kPa"
    if not isinstance(value, str):
        return f"{name}{value:.10g}" if isinstance(value, float) else f"{name}{value}"
    return f"{name}-{value}" if re.fullmatch(r"[A-Za-z0-9_.]+", value) else f"{name}{values.index(value) + 1}"


def label_rows(rows: Sequence[Fields]) -> list[tuple[str, Fields]]:
    """Return (suffix of the name, row) for rows of `pairs`: the first columns that tell the rows apart."""
    names = list(dict.fromkeys(name for row in rows for name in row.values))
    shown = range(1, len(names) + 1)
    enough = next((n for n in shown if len({first_of(row, names[:n]) for row in rows}) == len(rows)), len(names))
    columns = {name: [row.values.get(name) for row in rows] for name in names[:enough]}
    labels = ([label_of(n, row.values[n], columns[n]) for n in columns if n in row.values] for row in rows)
    return [("".join(f"-{part}" for part in label), row) for label, row in zip(labels, rows, strict=True)]


def first_of(row: Fields, names: Sequence[str]) -> tuple[object, ...]:
    """Return the values in some columns of a row of `pairs`; None for a column that the row lacks."""
    return tuple(row.values.get(name) for name in names)
