"""Markdown for pages that commands write."""

from __future__ import annotations


def table(header, rows):
    """A table as text; cells are text."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(header), *lines[1:]])
