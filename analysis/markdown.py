"""Markdown for the pages of the studies."""

from __future__ import annotations

import re
import string
from collections.abc import Collection, Iterable, Sequence

import numpy as np
import pandas

WORDS = 40  # characters of a cell from which on it is a sentence
BLANK = "\N{NO-BREAK SPACE}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int] = ()) -> str:
    """A table as text; cells are text. `right`: the columns, by number, that stand on the right."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    rule = "".join("---:|" if k in right else "---|" for k in range(len(header)))
    return "\n".join([lines[0], "|" + rule, *lines[1:]])


def frame_table(frame: pandas.DataFrame, marks: Sequence[str] = ()) -> str:
    """A pandas.DataFrame as a Markdown table for pandoc: numbers rounded and on the right, text taken literally.

    `marks`: for each row a class of the page's style, or "", that its cells get.
    """
    names = list(frame.columns)
    columns = [[_cell(x, name) for x in frame[name].astype(object)] for name in names]
    rows = [list(cells) for cells in zip(*columns, strict=True)]
    for row, mark in zip(rows, marks, strict=True):
        row[:] = [f"[{cell}]{{.{mark}}}" if mark and cell else cell for cell in row]
    numbers = {k for k, name in enumerate(names) if all(_is_number(x) for x in frame[name].dropna())}
    return table([literal(_heading(name)) for name in names], rows, numbers)


def literal(text: object) -> str:
    """Text in which no character means anything to Markdown."""
    return re.sub(f"([{re.escape(string.punctuation)}])", r"\\\1", " ".join(str(text).split()))


def number(value: float, digits: int = 4) -> str:
    """A number in so many digits, all that stand before its point, and a power of ten where it is very long; NaN and
    infinity are empty.
    """
    if not np.isfinite(value):
        return ""
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    if value == 0.0 or -5 < int(power) < 7:
        text = f"{value:.{max(0, digits - 1 - int(power))}f}"
    else:
        text = mantissa
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if value != 0.0 and not -5 < int(power) < 7:
        text += f"{BLANK}\N{MULTIPLICATION SIGN}{BLANK}10^{int(power)}^"
    return text.replace("-", "\N{MINUS SIGN}")


def _cell(value, name):
    if pandas.isna(value):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, np.integer)) and abs(value) < 1e7:
        return str(value)
    if _is_number(value):
        return number(value, 2 if ROUGH.search(name) else 4)
    return f"[{literal(value)}]{{.words}}" if len(value) > WORDS else literal(value)


ROUGH = re.compile("±|uncertainty|within|scatter|difference|interval|error|_se$")  # two digits say all


def _is_number(value):
    return isinstance(value, (int, float, np.number)) and not isinstance(value, (bool, np.bool_))


def _heading(name):
    return re.sub(r"_(?!zz\b)", " ", name)
