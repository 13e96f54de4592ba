"""A self-contained HTML page from Markdown, by pandoc: it embeds pictures, style and formulas (MathML)."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from types import ModuleType

from PIL import Image

from labkit.errors import InputError
from labkit.io import install_command, whole_file

OLDEST = (2, 19)  # first pandoc that embeds pictures
STYLE = Path(__file__).with_name("report.css")
LARGEST = 8e6  # bytes of a page
BASE64 = 4 / 3
WIDTHS = (2000, 1600, 1200, 900, 600)  # pixels of the embedded pictures; the first at which the page is small enough
LOSSLESS = 0.3  # bytes per pixel up to which a picture is embedded without loss
QUALITY = 85  # of the other pictures
PICTURE = re.compile(r"(!\[.*\]\()([^()]+\.png)(\))")
CONTENTS = re.compile(r'<nav id="TOC"[^>]*>(.*?)</nav>', re.DOTALL)
# The contents are open beside a wide page, and folded above a narrow one, where a tap on a link folds them again.
NAVIGATION = """<nav id="TOC" role="doc-toc"><details><summary>Contents</summary>{}</details></nav>
<script>
const contents = document.querySelector("#TOC details"), wide = matchMedia("(min-width: 70rem)");
const fold = () => {{ contents.open = wide.matches; }};
wide.addEventListener("change", fold);
contents.addEventListener("click", e => {{ if (e.target.closest("a")) fold(); }});
fold();
</script>"""


def write_page(markdown: str, folder: str | Path, output: str | Path) -> None:
    """Writes the page of pandoc's Markdown atomically; names of pictures are relative to `folder`.

    Raises InputError if pandoc is not installed.
    """
    pypandoc = _pypandoc()
    with tempfile.TemporaryDirectory() as scratch, whole_file(output) as temporary:
        page = pypandoc.convert_text(
            _with_small_pictures(markdown, Path(folder).resolve(), Path(scratch)),
            to="html5",
            format="markdown-smart",
            extra_args=[
                "--standalone",
                "--embed-resources",
                "--mathml",
                "--toc",
                "--toc-depth=2",
                "--columns=10000",
                f"--css={STYLE}",
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


def _with_small_pictures(markdown: str, folder: Path, scratch: Path) -> str:
    """The text with pictures replaced by WebP copies, as wide as the size of the page allows."""
    names = dict.fromkeys(match[2] for match in PICTURE.finditer(markdown) if (folder / match[2]).is_file())
    files: dict[str, Path] = {}
    for width in WIDTHS:
        files = {name: _copy(folder / name, scratch / f"{k}_{width}.webp", width) for k, name in enumerate(names)}
        if BASE64 * sum(file.stat().st_size for file in files.values()) < LARGEST - len(markdown.encode()):
            break
    return PICTURE.sub(lambda match: match[1] + str(files.get(match[2], match[2])) + match[3], markdown)


def _copy(file: Path, copy: Path, width: int) -> Path:
    """A copy of the picture, at most `width` pixels wide; without loss if that takes few bytes."""
    with Image.open(file) as image:
        small = image.convert("RGB")
        if small.width > width:
            small = small.resize((width, round(small.height * width / small.width)), Image.Resampling.LANCZOS)
    small.save(copy, lossless=True, quality=60, method=4)
    if copy.stat().st_size > LOSSLESS * small.width * small.height:
        small.save(copy, quality=QUALITY, method=4)
    return copy
