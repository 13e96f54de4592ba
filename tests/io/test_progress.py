"""Progress in the output of a notebook's cell."""

import pytest

from tests.conftest import PATIENCE

pytestmark = pytest.mark.slow

CELL = """
from labkit.io.progress import reporter
show = reporter("test")
for k in range(3):
    show(k / 2, f"step {k}")
"""


def test_a_stored_notebook_shows_the_last_line():
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed: pip install 'labkit[notebooks]'")
    import nbformat

    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(CELL)])
    nbclient.NotebookClient(notebook, timeout=PATIENCE, startup_timeout=PATIENCE).execute()
    (output,) = (one for one in notebook.cells[0].outputs if one.output_type == "display_data")
    assert output.data["text/plain"].startswith("test: 100%|##############################| 0:00:00 left, step 2")
