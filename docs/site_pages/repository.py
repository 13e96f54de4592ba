"""Files of the repository that pages link to: Markdown and code become pages of the site, other files are copied.

The pages in docs/ link to files as they lie in the repository (`../results/paper/sff.csv`), so that the links also work
in an editor. While the site is built they are rewritten to lead to the copies.
"""

import json
import os
import re
import shutil
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
PAGES = DOCS / "repository"  # generated, in the order of the repository
FILES = "files"  # folder of the site with copies of other files
LINK = re.compile(r"(!?)\[((?:[^\[\]]|!?\[[^\]]*\]\([^)]*\))*)\]\(([^)\s#:]+)(#[^)\s]*)?\)")
BESIDE = re.compile(r'(?:src|href)="([^":#]+)["#]')  # what an HTML page shows or links to
FENCED = re.compile(r"(^```.*?^```$)", re.DOTALL | re.MULTILINE)
LANGUAGES = {
    ".py": "python",
    ".yaml": "yaml+jinja",
    ".f90": "fortran",
    ".c": "c",
    ".sh": "sh",
    ".inp": "text",
    ".toml": "text",
    "": "text",
}


class Collection:
    """The pages and copies that the site needs in addition to docs/."""

    def __init__(self):
        """Start with the links of all pages in docs/."""
        self.files = set()
        self.pages = {}  # path of the file -> page
        self.queue = []

    def page_of(self, path):
        """The page of a Markdown, notebook or code file or of a folder; a new page is added to the queue."""
        if path not in self.pages:
            name = path.relative_to(ROOT)
            ending = "" if path.suffix in (".md", ".ipynb") else "/index.md" if path.is_dir() else ".md"
            self.pages[path] = PAGES / f"{name}{ending}"
            self.queue.append(path)
        return self.pages[path]

    def rewritten(self, text, source, page):
        """The text of a page with links to files of the repository changed to links within the site.

        source: folder of the repository from which the links count; page: the file in docs/ that holds the text.
        """
        parts = FENCED.split(text)
        parts[::2] = [LINK.sub(lambda match: self._link(match, source, page), part) for part in parts[::2]]
        return "".join(parts)

    def _link(self, match, source, page):
        image, text, target, anchor = match[1], match[2], match[3], match[4] or ""
        text = LINK.sub(lambda inner: self._link(inner, source, page), text)
        path = Path(os.path.normpath(source / target))
        if not path.exists():
            return match[0]  # Sphinx will say that it leads nowhere
        if path.is_relative_to(DOCS) or image:
            return f"{image}[{text}]({_relative(path, page)}{anchor})"
        if path.is_dir() and (path / "README.md").is_file():
            path = path / "README.md"
        if path.is_dir() or path.suffix in (".md", ".ipynb") or path.suffix in LANGUAGES:
            return f"[{text}]({_relative(self.page_of(path), page)}{anchor})"
        self.files.add(path)
        up = os.path.relpath(Path(FILES) / path.relative_to(ROOT), page.relative_to(DOCS).parent)
        return f'<a class="reference internal" href="{up}{anchor}">{text}</a>'

    def write_queue(self):
        """Write all pages in the queue, and those that they need."""
        while self.queue:
            path = self.queue.pop()
            page = self.pages[path]
            page.parent.mkdir(parents=True, exist_ok=True)
            write_if_changed(page, self._text(path, page))

    def _text(self, path, page):
        name = path.relative_to(ROOT)
        if path.suffix == ".ipynb":
            notebook = json.loads(path.read_text())
            notebook["metadata"] |= {"orphan": True, "mystnb": {"execution_mode": "off"}}  # it has its outputs
            return json.dumps(notebook)
        if path.suffix == ".md":
            return "---\norphan: true\n---\n\n" + self.rewritten(path.read_text(), path.parent, page)
        if path.is_dir():
            listing = self.rewritten(
                "\n".join(_list_files(file) for file in sorted(path.iterdir()) if _show_file(file)), path, page
            )
            return f"---\norphan: true\n---\n\n# {name}\n\n{listing}"
        code = f"```{{literalinclude}} {_relative(path, page)}\n:language: {LANGUAGES[path.suffix]}\n:linenos:\n```"
        return f"---\norphan: true\n---\n\n# {name}\n\n{code}\n"


def _list_files(file):
    """A line for a file, with a link, or for a folder, without: the site need not have all its files."""
    return f"- {file.name}/" if file.is_dir() else f"- [{file.name}]({file.name})"


def _show_file(file):
    return not file.name.startswith((".", "__")) and (file.is_dir() or file.suffix in {*LANGUAGES, ".md", ".txt"})


def _beside(file):
    """The files that an HTML page shows or links to."""
    names = BESIDE.findall(file.read_text()) if file.suffix == ".html" else []
    return {Path(os.path.normpath(file.parent / name)) for name in names}


def _relative(path, page):
    return os.path.relpath(path, page.parent)


def write_if_changed(file, text):
    """Write a generated page unless it has this text already, so that Sphinx reads only what changed."""
    if not file.exists() or file.read_text() != text:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)


def setup(app):
    """Write the pages, rewrite links while Sphinx reads, and copy the other files at the end."""
    collection = Collection()
    for page in DOCS.rglob("*.md"):
        if not page.is_relative_to(PAGES) and "_build" not in page.parts:
            collection.rewritten(page.read_text(), page.parent, page)
    collection.write_queue()
    for stale in set(PAGES.rglob("*")) - set(collection.pages.values()):
        if stale.is_file():
            stale.unlink()

    def read(app, docname, source):
        page = Path(app.env.doc2path(docname))
        if not page.is_relative_to(PAGES) and page.suffix == ".md":
            source[0] = collection.rewritten(source[0], page.parent, page)

    def copy(app, error):
        if error is None and app.builder.format == "html":
            for file in collection.files.union(*map(_beside, collection.files)):
                target = Path(app.outdir) / FILES / file.relative_to(ROOT)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)

    app.connect("source-read", read)
    app.connect("build-finished", copy)
