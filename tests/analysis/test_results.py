"""results/ stays small, and its manifests describe the files that are there."""

import subprocess
from pathlib import Path

import pytest
from PIL import Image

from analysis.manifest import BESIDE, MANIFEST, entries
from labkit.files import file_sha256
from tests.conftest import ROOT

LARGEST = 30e6  # bytes
TRACKED = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True).stdout.split("\0")
FILES = [ROOT / name for name in TRACKED if name.startswith("results/") and (ROOT / name).exists()]
PAGES = [ROOT / name for name in TRACKED if Path(name).suffix in (".md", ".html", ".ipynb") and (ROOT / name).exists()]

pytestmark = pytest.mark.skipif(not FILES, reason="not a clone")


def test_it_is_small():
    assert sum(file.stat().st_size for file in FILES) < LARGEST


def test_manifests_have_the_hashes_of_their_files():
    assert [file for file in FILES if file.name.endswith(BESIDE)] == [], "run ./lab results --tidy"
    known = {file.parent / name: one for file in FILES if file.name == MANIFEST for name, one in _entries(file)}
    changed = [str(file) for file, entry in known.items() if not file.is_file() or file_sha256(file) != entry["sha256"]]
    assert len(known) > 100 and changed == []


def _entries(file):
    return entries(file.parent).items()


def test_figures_have_few_colours_and_a_page_shows_them():
    figures = [file for file in FILES if file.suffix == ".png"]
    assert [str(file) for file in figures if Image.open(file).mode != "P"] == [], "run ./lab results --tidy"
    pages = {page: page.read_text(encoding="utf-8") for page in PAGES}
    shown = {(page.parent / name).resolve() for page, text in pages.items() for name in _pictures(text)}
    assert [str(file) for file in figures if file not in shown] == []


def _pictures(text):
    """The names of pictures on a page of Markdown or HTML."""
    return [
        part for part in text.replace('"', "\n").replace("(", "\n").replace(")", "\n").split("\n") if ".png" in part
    ]
