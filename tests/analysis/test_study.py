"""The framework of the studies: pages from templates, and every stored table and page from the stored data."""

import math
from pathlib import Path

import jinja2
import pandas
import pytest

from analysis.__main__ import STUDIES, main, study
from analysis.campaigns import write_tables
from analysis.manifest import MANIFEST, provenance
from analysis.pages import environment, lines, render, table
from analysis.places import results_folder
from analysis.study import Study

pytestmark = pytest.mark.slow

# Only the pages, because the tables take minutes or are made from the runs, and of two the tables that take seconds.
SLOW = ("model-benchmark", "speed-error", "hard-cases", "hidden-state")
FOUND = {name: study(module) for name, (module, *_) in STUDIES.items()}
FRAMED = {name: one for name, one in FOUND.items() if isinstance(one, Study) and (one.home / "page.md").exists()}
ROWS = pandas.DataFrame({"name": ["a", "b"], "value": [1.23456, math.nan], "within": [0.012, math.nan], "n": [3, 4]})


def test_a_table_takes_the_form_of_its_cells():
    text = table(ROWS, {"name": "*{name}*", "value": "{value ± within}", "p": "{value:.1f}", "n": "{n} of {n}"}, [3])
    assert text == (
        "| name | value | p | n |\n|---|---|---|---:|\n| *a* | 1.235 ± 0.012 | 1.2 | 3 of 3 |\n| *b* |  |  | 4 of 4 |"
    )
    assert table(ROWS[["value", "n"]]).splitlines()[2:] == ["| 1.23 | 3 |", "|  | 4 |"]
    assert lines(ROWS, "- {name}: {n}") == "- a: 3\n- b: 4"


def test_a_page_has_numbers_and_names_of_headings_and_no_unknown_name(tmp_path):
    file = tmp_path / "page.md"
    file.write_text("# Page {#top}\n\n{%# nobody reads this #%}\n{{ x | percent(1) }}, {{ x | pm(0.002) }}\n")
    assert render(file, {"x": 0.0234}) == "# Page {#top}\n\n2.3 %, 0.0234 ± 0.0020\n"
    with pytest.raises(jinja2.UndefinedError, match="x"):
        render(file, {})
    assert environment() is environment()


def test_a_page_without_its_tables_says_what_to_do(tmp_path, capsys):
    assert main(["model-benchmark", "--steps", "page", "-o", str(tmp_path)]) == 2
    assert "add `tables` to --steps" in capsys.readouterr().err


@pytest.mark.parametrize("name", FRAMED)
def test_the_stored_tables_and_page_follow_from_the_stored_data(name, tmp_path):
    one = FRAMED[name]
    stored = Path(results_folder(one.home.name))
    tables = sorted(stored.glob("*.csv"))
    command = provenance(stored / "README.md")["command"]
    data = stored / one.data
    copied = [*tables, *stored.glob("*.png")] if name in SLOW else []
    own = {data, stored / MANIFEST}
    own |= {file for file in map(Path, one.sources(stored)) if file.parent == stored}
    for file in (*own, *copied):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    one.write(tmp_path, command, lambda done, text: None, ["page"] if name in SLOW else ["tables", "page"])
    if name in ("hidden-state", "speed-error"):
        one.parts = ("twins",)  # of hidden-state
        write_tables(one.tables(one.read(tmp_path / one.data)), tmp_path, [data], command, one.rounding)
    for file in (*tables, stored / "README.md"):
        assert (tmp_path / file.name).read_bytes() == file.read_bytes(), file.name
