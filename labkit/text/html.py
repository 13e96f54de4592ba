"""Small HTML tables for values that notebooks show (`_repr_html_`)."""

from __future__ import annotations

import html
from collections.abc import Mapping


def html_table(title: str, rows: Mapping[str, object]) -> str:
    """Return an HTML table with a title and one line per entry, name -> value; all text is escaped."""
    cell = '<td style="text-align: left; padding-right: 1em">'
    lines = [
        f"<tr>{cell}{html.escape(name)}</td>{cell}{html.escape(str(value))}</td></tr>" for name, value in rows.items()
    ]
    caption = f'<caption style="text-align: left"><b>{html.escape(title)}</b></caption>'
    return f"<table>{caption}<tbody>{''.join(lines)}</tbody></table>"
