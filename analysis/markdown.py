"""Markdown for the pages of the studies."""

from __future__ import annotations

import math
import re
import string
from collections.abc import Collection, Iterable, Sequence

import numpy as np
import pandas

WORDS = 40  # characters; a longer cell is set as a paragraph
BLANK = "\N{NO-BREAK SPACE}"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int] = ()) -> str:
    """A Markdown table from text cells. `right`: indices of the right-aligned columns."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    rule = "".join("---:|" if k in right else "---|" for k in range(len(header)))
    return "\n".join([lines[0], "|" + rule, *lines[1:]])


def frame_table(frame: pandas.DataFrame, marks: Sequence[str] = ()) -> str:
    """A pandas.DataFrame as a Markdown table for pandoc: numbers rounded and right-aligned, text escaped.

    `marks`: for each row the CSS class of its cells, or "".
    """
    names = list(frame.columns)
    columns = [[_cell(x, name) for x in frame[name].astype(object)] for name in names]
    rows = marked([list(cells) for cells in zip(*columns, strict=True)], marks)
    numbers = {k for k, name in enumerate(names) if all(_is_number(x) for x in frame[name].dropna())}
    return table([literal(_heading(name)) for name in names], rows, numbers)


def marked(rows: Sequence[Sequence[str]], marks: Sequence[str] = ()) -> list[list[str]]:
    """Rows of Markdown cells with the CSS class `marks[k]` on every cell of row k; "" for no class."""
    if not marks:
        return [list(row) for row in rows]
    return [
        [f"[{cell}]{{.{mark}}}" if mark and cell else cell for cell in row]
        for row, mark in zip(rows, marks, strict=True)
    ]


def literal(text: object) -> str:
    """Text with all Markdown special characters escaped."""
    return re.sub(f"([{re.escape(string.punctuation)}])", r"\\\1", " ".join(str(text).split()))


def number(value: float, digits: int = 4) -> str:
    """A number with at least `digits` significant digits, in scientific notation if very long.

    All digits before the decimal point are kept. NaN and infinity give an empty string.
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


def text(value: float, within: float = math.nan, digits: int = 3) -> str:
    """`0.9381 ± 0.0057`: rounded so that the half-width has two significant digits.

    Without a half-width the number has `digits` significant digits, or all digits before its decimal point.
    """
    if not math.isfinite(value):
        return ""
    if not (math.isfinite(within) and within > 0.0):
        return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"
    decimals = max(0, 1 - math.floor(math.log10(within)))
    return f"{value:.{decimals}f} ± {within:.{decimals}f}"


def _cell(value: object, name: str) -> str:
    if pandas.isna(value):
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, np.integer)) and abs(int(value)) < 10**7:
        return str(value)
    if isinstance(value, (float, np.number)):
        return number(float(value), 2 if ROUGH.search(name) else 4)
    return f"[{literal(value)}]{{.words}}" if len(str(value)) > WORDS else literal(value)


ROUGH = re.compile("±|uncertainty|within|scatter|difference|interval|error|_se$")  # two digits suffice


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, (bool, np.bool_))


def _heading(name: str) -> str:
    return re.sub(r"_(?!zz\b)", " ", name)
