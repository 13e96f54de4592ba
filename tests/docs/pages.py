"""The pages of docs/: their code cells, links and headings."""

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
GENERATED = ("_build", "repository", "generated")


def pages():
    """All pages that are kept in git."""
    return sorted(page for page in DOCS.rglob("*.md") if not set(page.relative_to(DOCS).parts) & set(GENERATED))


def cells(page):
    """Code cells of a notebook, without the options of the cell."""
    return re.findall(r"```\{code-cell\} ipython3\n((?:.|\n)*?)```", page.read_text())
