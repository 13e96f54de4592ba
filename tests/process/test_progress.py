"""Progress in the output of a notebook's cell, and on a terminal."""

import pytest

from labkit.process.progress import Bar, on_terminal
from tests.conftest import PATIENCE

CELL = """
from labkit.process.progress import reporter
show = reporter("test")
for k in range(3):
    show(k / 2, f"step {k}")
"""


@pytest.mark.slow
def test_a_stored_notebook_shows_the_last_line():
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install 'labkit[notebooks]'")
    import nbformat

    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    nbclient.NotebookClient(notebook, timeout=PATIENCE, startup_timeout=PATIENCE).execute()
    (output,) = (one for one in notebook.cells[0].outputs if one.output_type == "display_data")
    assert output.data["text/plain"].startswith("test: 100%|##############################| 0:00:00 left, step 2")


def test_a_terminal_shows_one_line_that_fits(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "71")
    report = Bar("test", on_terminal)
    for fraction, text in ((0.0, "a long text at first, which is cut off"), (0.5, "half"), (1.0, "end")):
        report(fraction, text)
    first, *lines = capsys.readouterr().out.split("\r")
    assert first == "" and [len(line) for line in lines] == [70, 70, 71] and lines[2].endswith("\n")
    assert lines[1].rstrip() == f"test:  50%|{15 * '#':30}| 0:00:00 left, half"
