"""The documentation site builds without a warning, with live links. test_tutorials.py executes its tutorials."""

import subprocess
import sys

import pytest

from tests.conftest import PATIENCE
from tests.docs.pages import DOCS, pages

pytestmark = pytest.mark.long

# Left to `./lab docs`: the execution of the tutorials, the pages of the source code, and the look of a page.
EXTENSIONS = "extensions=myst_nb,sphinx.ext.autodoc,sphinx.ext.autosummary,sphinx_copybutton"
LEFT_OUT = ("-D", "nb_execution_mode=off", "-D", EXTENSIONS, "-D", "html_theme=basic")


def test_is_built_without_a_warning_and_its_stored_pages_are_those_of_the_code(tmp_path):
    """The build writes the pages of the reference that are stored, so that they can be read in a clone, again."""
    pytest.importorskip("sphinx", reason="sphinx is not installed: pip install -e '.[docs]'")
    stored = {page: page.read_text() for page in (DOCS / "reference").glob("*.md")}
    options = ["-W", "--keep-going", "-q", *LEFT_OUT, "-d", tmp_path / "doctrees"]
    command = [sys.executable, "-m", "sphinx", *options, "-b", "html", DOCS, tmp_path / "html"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    for page in pages():
        assert (tmp_path / "html" / page.relative_to(DOCS).with_suffix(".html")).is_file()
    assert [page.name for page, text in stored.items() if page.read_text() != text] == [], "old, now written again"
