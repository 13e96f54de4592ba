"""The page of definitions and the table of quantities in the code are one."""

import re

from labkit.quantities import QUANTITIES
from labkit.quantities.scalars import Facts
from tests.docs.pages import DOCS

RESTRICTIONS = {"undrained": "undrained only", "cyclic": "tests that reverse", "every_record": "not in conditions"}


def test_the_page_lists_the_quantities_of_the_code():
    page = (DOCS / "definitions.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| (.*?) \| (.*) \| (.*?) ?\|$", page, re.MULTILINE)
    listed = {name: (unit, meaning, restricted.strip()) for name, unit, meaning, _, restricted in rows}
    coded = {
        name: (row.unit, row.label(Facts()), ", ".join(text for key, text in RESTRICTIONS.items() if getattr(row, key)))
        for name, row in QUANTITIES.items()
    }
    assert listed == coded and list(listed) == list(coded)
    assert all(definition.strip() for *_, definition, _ in rows)
