"""Links of all Markdown pages and the names of functions in them; `./lab docs` checks the links of the site itself."""

import importlib
import re

from tests.docs.pages import DOCS, pages

ROOT = DOCS.parent
BESIDE = [*(ROOT / "analysis").glob("*.md"), *(ROOT / "results").rglob("*.md")]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted(BESIDE), *pages()]
LINK = re.compile(r"\]\((?!https?:|mailto:|/)([^)\s#]*)(#[^)\s]*)?\)")
EQUATIONS = {f"eq-{k}" for k in [*range(1, 35), *(f"c{k}" for k in range(6))]}  # equations of the paper


def text_of(page):
    return re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def anchors(page):
    """Anchors of a page: its headings as GitHub and MyST write them, and explicit targets."""
    text = text_of(page)
    headings = [
        re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in re.findall(r"^#+ (.*)$", text, re.M)
    ]
    return {*headings, *re.findall(r"^\(([\w-]+)\)=$", text, re.M)}


def leads_somewhere(page, target, anchor):
    file = (page.parent / target).resolve() if target else page
    if not file.exists():
        return False
    named = anchor.removeprefix("#")
    return not named or file.suffix != ".md" or named in EQUATIONS or named in anchors(file)


def test_every_link_leads_somewhere():
    links = [(page, *link) for page in PAGES for link in LINK.findall(text_of(page))]
    broken = [
        (str(page), target + anchor) for page, target, anchor in links if not leads_somewhere(page, target, anchor)
    ]
    assert broken == []


def test_every_equation_of_the_paper_has_code():
    theory = (DOCS / "theory.md").read_text()
    blocks = re.findall(r"^\((eq-\w+)\)=\n\$\$\n(.*?)\n\$\$\n\nCode: ([^\n]*)$", theory, re.MULTILINE | re.DOTALL)
    assert {label for label, _, _ in blocks} == EQUATIONS
    for label, formula, code in blocks:
        assert rf"\text{{({label.removeprefix('eq-').upper()})}}" in formula
        names = re.findall(r"\{py:\w+\}`~?(labkit[\w.]+)`", code)
        assert names and all(resolved(name) is not None for name in names), label


def resolved(name):
    """The object of a dotted name."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for part in parts[k:]:
            found = getattr(found, part)
        return found
    raise AssertionError(name)


def test_every_function_that_a_page_names_exists():
    for page in pages():
        for name in re.findall(r"\{py:\w+\}`~?(labkit[\w.]*)`", page.read_text()):
            resolved(name)  # raises an error with the wrong name


def test_every_page_is_in_the_table_of_contents():
    listed = re.findall(r"```\{toctree\}(.*?)```", "".join(page.read_text() for page in pages()), re.DOTALL)
    patterns = [line for block in listed for line in block.split() if not line.startswith(":")]
    for page in pages():
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        here = [pattern for pattern in patterns if page.match(pattern + ".md") or name == pattern]
        assert here or name == "index", name
