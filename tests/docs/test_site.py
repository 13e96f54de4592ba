"""The documentation site builds without a warning, with live links. test_tutorials.py executes its tutorials."""

import subprocess
import sys

import pytest

from tests.conftest import PATIENCE
from tests.docs.pages import DOCS, pages

pytestmark = pytest.mark.slow


def test_is_built_without_a_warning(tmp_path):
    pytest.importorskip("sphinx", reason="sphinx is not installed: pip install -e '.[docs]'")
    options = ["-W", "--keep-going", "-q", "-D", "nb_execution_mode=off", "-d", tmp_path / "doctrees"]
    # without viewcode, which takes a third of the time to highlight the sources
    options += ["-D", "extensions=myst_nb,sphinx.ext.autodoc,sphinx.ext.autosummary,sphinx_copybutton"]
    command = [sys.executable, "-m", "sphinx", *options, "-b", "html", DOCS, tmp_path / "html"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    for page in pages():
        assert (tmp_path / "html" / page.relative_to(DOCS).with_suffix(".html")).is_file()
