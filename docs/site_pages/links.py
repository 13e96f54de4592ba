"""Checks the finished site: every link within it leads to a page and an anchor, and it loads nothing from elsewhere."""

import functools
import html.parser
import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.errors import ExtensionError

LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}
WITHOUT_PAGE = ("search.html", "genindex.html", "py-modindex.html")


class Page(html.parser.HTMLParser):
    """Links, anchors and loaded files of a page."""

    def __init__(self, file: Path) -> None:
        """Read a page."""
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = {""}
        self.loaded: set[str] = set()
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        """Collect what a tag refers to."""
        values = dict(attributes)
        self.anchors |= {values[name] for name in ("id", "name") if values.get(name)}
        if tag == "a" and values.get("href"):
            self.links.add(values["href"])
        if tag in LOADED and values.get(LOADED[tag]):
            self.loaded.add(values[LOADED[tag]])


def problems(folder: Path) -> list[str]:
    """One line for every link that leads nowhere and every file from another server."""
    pages = {file.resolve(): Page(file) for file in folder.rglob("*.html")}
    found = [f"{file.name}: a command was not found" for file in pages if "command not found" in file.read_text()]
    for file, page in pages.items():
        name = file.relative_to(folder.resolve())
        for link in sorted(page.links | page.loaded):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    found.append(f"{name}: {link} is loaded from another server")
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not target.exists() and target.name not in WITHOUT_PAGE:
                found.append(f"{name}: {link} leads nowhere")
            elif (
                target in pages and unquote(parts.fragment) not in pages[target].anchors and ":~:" not in parts.fragment
            ):
                found.append(f"{name}: {link} has no such anchor")
    return found


BACK = re.compile(r'(<a class="viewcode-back" href=")([^"#]*)#([^"]*)(")')


def mend_sources(folder: Path) -> None:
    """Correct links from source code to the reference: Sphinx expects a module in one package only."""
    anchors_of = functools.cache(lambda file: Page(file).anchors)
    for file in (folder / "_modules").rglob("*.html"):

        def mend(match, file=file):
            anchors, parts = anchors_of((file.parent / match[2]).resolve()), match[3].split(".")
            ends = (".".join(parts[k:]) for k in range(len(parts)))
            known = (anchor for end in ends for anchor in anchors if f".{anchor}".endswith(f".{end}"))
            return f"{match[1]}{match[2]}#{next(known, match[3])}{match[4]}"

        text = file.read_text(encoding="utf-8")
        if BACK.search(text):
            file.write_text(BACK.sub(mend, text), encoding="utf-8")


def setup(app):
    """Check the site at the end of a build."""

    def check(app, error):
        if error is None and app.builder.name == "html":
            mend_sources(Path(app.outdir))
            found = problems(Path(app.outdir))
            if found:
                raise ExtensionError("\n".join(["links of the site:", *found]))

    app.connect("build-finished", check, priority=900)
