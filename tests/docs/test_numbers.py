"""Numbers on pages that are written by hand are those of the stored tables: numbers.yaml lists both."""

import functools
import re

import nbformat
import pandas
import pytest
import yaml

from tests.docs.pages import DOCS

ROOT = DOCS.parent
LISTED = yaml.safe_load((ROOT / "tests/docs/numbers.yaml").read_text())
SENTENCES = [(page, sentence) for page, sentences in LISTED["pages"].items() for sentence in sentences]
FIELD, NAME = re.compile(r"\{([^{}]+):([^{}:]+)\}"), re.compile(r"\{(\w+)\}")


def number(table, rows, text, wide=None):
    """The text with its {expression:format} evaluated for the rows of a table in results/."""
    frame = pandas.read_csv(ROOT / "results" / table)
    frame = frame.query(rows) if rows else frame
    frame = frame if wide is None else frame.pivot(index=wide[0], columns=wide[1], values=wide[2])

    def value(field):
        found = eval(field[1], {"rows": frame, **frame})
        short = format(found.item() if isinstance(found, pandas.Series) else found, field[2])
        return re.sub(r"e-0(\d)", r"e-\1", short)

    return FIELD.sub(value, text)


@functools.cache
def text_of(page):
    """The text of a page, or of the Markdown cells of a notebook, on one line."""
    file = ROOT / page
    if file.suffix != ".ipynb":
        return " ".join(file.read_text().split())
    cells = nbformat.read(file, 4).cells
    return " ".join(" ".join(cell.source for cell in cells if cell.cell_type == "markdown").split())


@pytest.mark.parametrize(("page", "sentence"), SENTENCES)
def test_a_number_on_a_page_is_that_of_its_table(page, sentence):
    expected = NAME.sub(lambda name: number(*LISTED["numbers"][name[1]]), sentence)
    somehow = re.search(".{1,60}".join(map(re.escape, NAME.split(sentence)[::2])), text_of(page))
    assert expected in text_of(page), f"{page} says: {somehow and somehow[0]}"


def test_every_number_listed_stands_on_a_page():
    used = [name for _, sentence in SENTENCES for name in NAME.findall(sentence)]
    assert set(used) == set(LISTED["numbers"]) and all(NAME.search(sentence) for _, sentence in SENTENCES)
