"""The key `pairs` of an entry of a campaign file: values that belong together, instead of all combinations."""

from __future__ import annotations

from collections.abc import Mapping

from labkit.io.document import Block, Fields, Node, Rows, kind_of, read_fields
from labkit.io.labels import first_of
from labkit.parameters import Parameter

PAIRS = "pairs"


def read_pairs(node: Node, known: Mapping[str, Parameter], fields: Fields) -> None:
    """Read `pairs`, a list of mappings whose values belong together, into the Fields of the mapping `node`."""
    if not isinstance(node, Block) or PAIRS not in node:
        return
    rows, where = node[PAIRS], f"{fields.where}: {PAIRS}"
    if not isinstance(rows, Rows) or not rows:
        fields.error(
            f"{PAIRS} is {kind_of(rows)}: give a list, e.g. - {{void_ratio: 0.62, step1_friction: 0.05}}", PAIRS
        )
        fields.broken.add(PAIRS)
        return
    fields.pairs = [read_fields(row, known, f"{where}, row {n}", fields.errors) for n, row in enumerate(rows, 1)]
    for row in fields.pairs:
        for name in row.lines:
            if fields.has(name):
                row.error(f"{name} is also given outside of {PAIRS}: give it once", name)
    valid = [row for row in fields.pairs if row.values]
    if len({first_of(row, list(known)) for row in valid}) < len(valid):
        fields.error(f"{PAIRS} lists the same values twice: leave one row out", PAIRS)
        fields.broken.add(PAIRS)
