"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Collection[int] = ()) -> str:
    """A table as text; cells are text. `right`: the columns, by number, that stand on the right."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (header, *rows)]
    rule = "".join("---:|" if k in right else "---|" for k in range(len(header)))
    return "\n".join([lines[0], "|" + rule, *lines[1:]])
