"""The stored pages of the reference, which can be read in a clone, match the code."""

import subprocess
import sys

import pytest

from tests.docs.pages import DOCS

pytestmark = pytest.mark.slow

CHECK = """
import pathlib, sys
from site_pages import reference
old = [name for name, text in reference.stored().items() if pathlib.Path(sys.argv[1], name + ".md").read_text() != text]
sys.exit(f"{old} are old: PYTHONPATH=docs python -m site_pages.reference writes them again" if old else 0)
"""


def test_stored_pages_are_those_of_the_code():
    done = subprocess.run([sys.executable, "-c", CHECK, DOCS / "reference"], cwd=DOCS, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
