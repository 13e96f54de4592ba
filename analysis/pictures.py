"""Figures of the studies, stored with few colours: a third of the space, and lines and text look the same."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from labkit.figures import plots
from labkit.files import whole_file

COLOURS = 256


def save(
    figure: Figure,
    file: str | Path,
    sources: Sequence[str | Path] = (),
    command: str | None = None,
    dpi: int = plots.DPI,
) -> None:
    """Saves a figure as a PNG file of few colours with its provenance, and closes it. `sources`: files it shows."""
    plots.save(figure, file, sources, command, dpi)
    reduce_colours(file)


def reduce_colours(file: str | Path) -> None:
    """Rewrites a PNG file with at most COLOURS colours; its texts, such as the provenance, and resolution stay."""
    with Image.open(file) as image:
        if image.mode == "P":
            return
        texts = PngInfo()
        for name, text in image.info.items():
            if isinstance(name, str) and isinstance(text, str):
                texts.add_text(name, text)
        few = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
        resolution = {"dpi": image.info["dpi"]} if "dpi" in image.info else {}
    with whole_file(file) as temporary:
        few.save(temporary, "PNG", optimize=True, pnginfo=texts, **resolution)
