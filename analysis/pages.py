"""Pages of the studies: Markdown templates with named numbers and tables (Jinja2)."""

from __future__ import annotations

import functools
import math
import re
import string
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas

from analysis import markdown
from analysis.places import STUDIES
from analysis.statistics import in_bold


def render(template: str | Path, values: Mapping[str, Any]) -> str:
    """The page that a template file makes of named values.

    A name without a value is an error. Templates include others by their paths in analysis/. Several blank lines become
    one.
    """
    page = environment().from_string(Path(template).read_text(encoding="utf-8")).render(values)
    return re.sub(r"\n{3,}", "\n\n", page).strip() + "\n"


@functools.cache
def environment() -> jinja2.Environment:
    """Jinja2 with the filters of the pages.

    A comment is `{%# ... #%}`, because pandoc's names of headings are `{#...}`. The filters:

    pm(within, digits)      0.938 ± 0.057
    fmt(".2g")              a number in one of Python's formats; nothing for NaN
    percent(1)              0.023 as `2.3 %`
    number(4)               a number for readers, as of markdown.number
    table({heading: cell})  a data frame as a Markdown table, see `table`
    lines("- {name}")       a data frame as a list, a line per row in the form of a cell of a table
    in_bold                 a data frame with the column `bold` (analysis.statistics)
    """
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(STUDIES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        comment_start_string="{%#",
        comment_end_string="#%}",
        autoescape=False,
    )
    made.filters |= {
        "pm": markdown.text,
        "fmt": fmt,
        "percent": percent,
        "number": markdown.number,
        "table": table,
        "lines": lines,
        "in_bold": in_bold,
        "literal": markdown.literal,
        "frame_table": markdown.frame_table,
    }
    return made


def fmt(value: float, spec: str) -> str:
    """A number in one of Python's formats, or in percent, `.1 %` or `.2g %`; "" for NaN and infinity."""
    if not math.isfinite(value):
        return ""
    if spec.endswith(" %"):
        digits = spec[:-2]
        return f"{100.0 * value:{digits}{'f' * digits[-1:].isdigit()}} %"
    return format(value, spec)


def percent(value: float, decimals: int = 0) -> str:
    """A fraction in percent."""
    return fmt(value, f".{decimals} %")


def table(frame: pandas.DataFrame, columns: Mapping[str, str] | None = None, right: Sequence[int] = ()) -> str:
    """A data frame as a Markdown table.

    Args:
        frame: one row per row of the table.
        columns: heading -> cell, in which `{name}` is the value of a column, `{name:.2g}` the value in one of Python's
            formats, and `{name ± within}` the value with its interval. Default: all columns by their own names.
        right: indices of the columns that are aligned on the right.
    """
    cells = columns if columns is not None else {str(name): f"{{{name}}}" for name in frame.columns}
    rows = [[CELL.vformat(cell, (), row) for cell in cells.values()] for row in frame.to_dict("records")]
    return markdown.table(list(cells), rows, right)


def lines(frame: pandas.DataFrame, line: str) -> str:
    """A line for each row of a data frame, formatted like a cell of `table`."""
    return "\n".join(CELL.vformat(line, (), row) for row in frame.to_dict("records"))


class _Cell(string.Formatter):
    """The format of a cell: see `table`. Numbers without a format are rounded to three digits; NaN gives no text."""

    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> tuple[Any, str]:
        name, _, within = field_name.partition(" ± ")
        return (markdown.text(kwargs[name], kwargs[within]) if within else kwargs[name]), name

    def format_field(self, value: Any, format_spec: str) -> str:
        if not isinstance(value, float):
            return "" if value is None else format(value, format_spec)
        return fmt(value, format_spec) if format_spec else markdown.text(value)


CELL = _Cell()
