"""Checks the finished site: every link within it leads to a page and an anchor, and it loads nothing from elsewhere."""

import html.parser
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
    pages = {
        file.resolve(): Page(file) for file in folder.rglob("*.html") if "files" not in file.relative_to(folder).parts
    }
    found = []
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


def setup(app):
    """Check the site at the end of a build."""

    def check(app, error):
        if error is None and app.builder.name == "html":
            found = problems(Path(app.outdir))
            if found:
                raise ExtensionError("\n".join(["links of the site:", *found]))

    app.connect("build-finished", check, priority=900)
