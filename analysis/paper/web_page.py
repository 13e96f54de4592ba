"""An HTML page from Markdown, by pandoc: it contains its style and formulas (MathML), and links to its pictures."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from types import ModuleType

from labkit.errors import InputError
from labkit.files import whole_file
from labkit.process import install_command

OLDEST = (2, 19)  # pandoc; earlier versions are untested
STYLE = Path(__file__).with_name("report.css")
PICTURE = re.compile(r"(!\[.*\]\()([^()]+\.png)(\))")
CONTENTS = re.compile(r'<nav id="TOC"[^>]*>(.*?)</nav>', re.DOTALL)
# The table of contents is open next to a wide page and folded above a narrow one, where tapping a link folds it.
NAVIGATION = """<nav id="TOC" role="doc-toc"><details><summary>Contents</summary>{}</details></nav>
<script>
const contents = document.querySelector("#TOC details"), wide = matchMedia("(min-width: 70rem)");
const fold = () => {{ contents.open = wide.matches; }};
wide.addEventListener("change", fold);
contents.addEventListener("click", e => {{ if (e.target.closest("a")) fold(); }});
fold();
</script>"""


def write_page(markdown: str, folder: str | Path, output: str | Path) -> None:
    """Writes the page of pandoc's Markdown atomically; names of pictures in the text are relative to `folder`.

    The pictures stay where they are: the page links to them from the folder of `output`. Raises InputError if pandoc is
    not installed.
    """
    pypandoc = _pypandoc()
    with tempfile.TemporaryDirectory() as scratch, whole_file(output) as temporary:
        style = Path(scratch) / "style.html"
        style.write_text(f"<style>\n{STYLE.read_text(encoding='utf-8')}</style>\n", encoding="utf-8")
        page = pypandoc.convert_text(
            _linked(markdown, Path(folder).resolve(), Path(output).resolve().parent),
            to="html5",
            format="markdown-smart",
            extra_args=[
                "--standalone",
                "--mathml",
                "--toc",
                "--toc-depth=2",
                "--columns=10000",
                "--metadata=document-css=false",
                f"--include-in-header={style}",
            ],
        )
        page = CONTENTS.sub(lambda match: NAVIGATION.format(match[1]), page, count=1)
        Path(temporary).write_text(page, encoding="utf-8")


def _pypandoc() -> ModuleType:
    try:
        import pypandoc

        available = pypandoc.ensure_pandoc_minimal_version(*OLDEST)
    except (ImportError, OSError):
        available = False
    if not available:
        raise InputError(
            f"the report needs pandoc {'.'.join(map(str, OLDEST))} or later: "
            f"install it with {install_command('report')}"
        )
    return pypandoc


def _linked(markdown: str, folder: Path, place: Path) -> str:
    """The text with the names of its pictures, relative to `folder`, as they are seen from `place`."""
    return PICTURE.sub(lambda match: f"{match[1]}{os.path.relpath(folder / match[2], place)}{match[3]}", markdown)
