"""One self-contained HTML page of Markdown, by pandoc: pictures, style and formulas (MathML) are in it, no scripts."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from PIL import Image

from labkit.errors import InputError
from labkit.io import whole_file

OLDEST = (2, 19)  # pandoc that embeds pictures
STYLE = Path(__file__).with_name("report.css")
LARGEST = 15e6  # bytes of a page
BASE64 = 4 / 3
WIDTHS = (1600, 1200, 900, 600)  # pixels of pictures in a page that is too large
PICTURE = re.compile(r"(!\[.*\]\()([^()]+\.png)(\))")


def write_page(markdown: str, folder: str | Path, output: str | Path) -> None:
    """Writes the page of pandoc's Markdown, whole or not at all; names of pictures are relative to `folder`. Raises
    InputError if pandoc is not installed.
    """
    pypandoc = _pypandoc()
    with tempfile.TemporaryDirectory() as scratch, whole_file(output) as temporary:
        pypandoc.convert_text(
            _with_small_pictures(markdown, Path(folder).resolve(), Path(scratch)),
            to="html5",
            format="markdown-smart",
            outputfile=str(temporary),
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


def _pypandoc():
    try:
        import pypandoc

        there = pypandoc.ensure_pandoc_minimal_version(*OLDEST)
    except (ImportError, OSError):
        there = False
    if not there:
        raise InputError(
            f"the report needs pandoc {'.'.join(map(str, OLDEST))} or later: install it with pip install "
            "'labkit[report]', or in a checkout with pip install '.[report]'"
        )
    return pypandoc


def _with_small_pictures(markdown, folder, scratch):
    """The text with absolute names of pictures, of narrower copies where they are too large together."""
    names = dict.fromkeys(found[2] for found in PICTURE.finditer(markdown) if (folder / found[2]).is_file())
    files = {name: folder / name for name in names}
    for width in WIDTHS:
        if BASE64 * sum(file.stat().st_size for file in files.values()) < LARGEST - len(markdown.encode()):
            break
        files = {name: _narrow(folder / name, scratch / f"{k}_{width}.png", width) for k, name in enumerate(names)}
    return PICTURE.sub(lambda found: found[1] + str(files.get(found[2], found[2])) + found[3], markdown)


def _narrow(file, copy, width):
    """The picture itself, or its copy `width` pixels wide."""
    with Image.open(file) as image:
        if image.width <= width:
            return file
        size = width, round(image.height * width / image.width)
        image.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(copy, optimize=True)
    return copy
