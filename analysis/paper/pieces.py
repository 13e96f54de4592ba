"""Pieces of the report in pandoc's Markdown: tables of data files, pictures with captions, notes on missing files."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import pandas
from PIL import Image

from analysis import markdown

CAPTIONS = pandas.read_csv(Path(__file__).with_name("captions.csv")).set_index("file")
SHOWN = {  # file -> column -> heading; other columns are left out
    "fidelity_causes.csv": {
        "number": "number",
        "cause": "cause",
        "alternative": "alternative",
        "effect": "effect",
        "within": "± (95 %)",
        "p_value": "p-value",
        "holm": "Holm",
        "fdr": "Benjamini-Hochberg",
        "matters": "resolved",
        "tests": "specimens",
        "difference": "difference",
        "difference_left": "remaining difference",
    },
    "one_critical_line.csv": {
        "line": "line",
        "factor": "by",
        "group": "group",
        "tests": "tests",
        "specimens": "specimens",
        "offset": "offset",
        "within": "± (95 %)",
        "scatter": "scatter around the line",
        "shared": "shared by a specimen",
        "p_value": "p-value",
        "corrected": "Holm",
    },
    "stationarity.csv": {
        "path": "path",
        "quantity": "quantity",
        "tests": "tests",
        "specimens": "specimens",
        "mean": "mean",
        "slope": "slope",
        "within": "± (95 %)",
        "p_value": "p-value",
        "corrected": "Holm",
        "judged": "matters from",
        "passed": "passed",
        "verdict": "verdict",
    },
    "c0_bias.csv": {
        "path": "path",
        "quantity": "quantity",
        "tests": "tests",
        "specimens": "specimens",
        "bias": "mean error",
        "within": "± (95 %)",
        "corrected": "Holm",
        "rms": "RMS, mean of tests",
        "most_rms": "largest RMS",
        "low": "low",
    },
    "critical_lines.csv": {
        "line": "line",
        "parameter": "parameter",
        "value": "ours",
        "within": "± (95 %)",
        "paper": "paper",
        "tests": "tests",
        "specimens": "specimens",
    },
    "engines.csv": {
        "test": "test",
        "kind": "engine, contact law",
        "grains": "grains",
        "peak": "peak",
        "M": "M",
        "e": "e",
        "Z": "Z",
        "Lambda": "Λ",
        "off_peak": "Δ peak",
        "off_M": "Δ M",
        "off_e": "Δ e",
        "off_Z": "Δ Z",
        "off_Lambda": "Δ Λ",
    },
    "sff.csv": {
        "run": "run",
        "path": "path",
        "records": "records",
        "worst": "worst error",
        "mean": "mean error",
        "over": "records above 2 %",
        "worst_strain": "worst at strain",
        "worst_p_MPa": "at p, MPa",
        "explanation": "explanation",
    },
}


def join(*parts: str) -> str:
    """Joins the non-empty parts of a text as paragraphs."""
    return "\n\n".join(part for part in parts if part)


def csv_table(file: Path, label: str, command: str, fold: bool = False) -> str:
    """A CSV file as a table, coloured by verdict; if it is missing, a note naming the command that writes it."""
    if not file.is_file():
        return missing(file.name, command)
    frame = pandas.read_csv(file, dtype_backend="numpy_nullable")
    shown, marks = SHOWN.get(file.name, {}), _marks(frame)
    if set(shown) <= set(frame):
        frame = frame[list(shown) or list(frame)].rename(columns=shown)
    return table(frame, label, fold, marks)


def table(frame: pandas.DataFrame, label: str, fold: bool = False, marks: Sequence[str] = ()) -> str:
    """A pandas.DataFrame as a table, optionally collapsed. `marks`: for each row `inside`, `outside` or ""."""
    boxed = box(markdown.frame_table(frame, marks), label)
    return f"<details>\n<summary>{label}: {len(frame)} rows</summary>\n\n{boxed}\n\n</details>" if fold else boxed


def _marks(frame: pandas.DataFrame) -> Sequence[str]:
    """`inside` or `outside` for every row of a table with a column `over`, the number of records above a limit."""
    if "over" in frame:
        return ["" if pandas.isna(count) else "outside" if count else "inside" for count in frame["over"]]
    return ()


def box(text: str, label: str, kind: str = "") -> str:
    """A Markdown table in a box that scrolls sideways, also with the keyboard, if it is wider than the page.

    `kind`: a further CSS class.
    """
    classes = ".table" + (f" .{kind}" if kind else "")
    return f'::: {{{classes} tabindex="0" role="region" aria-label="{label}"}}\n{text}\n:::'


def missing(what: str, command: str) -> str:
    """A note on missing files and the command that writes them."""
    return f"::: missing\nMissing: {markdown.literal(what)}. Written by `{command}`.\n:::"


def pictures(section: str, folder: Path, command: str) -> str:
    """The pictures of a section, and a note naming the command that draws the missing ones."""
    names = names_of(section)
    absent = [Path(name).name for name in names if not (folder / name).is_file()]
    drawn = [picture(name, folder) for name in names if (folder / name).is_file()]
    return join(*drawn, missing(", ".join(absent), command) if absent else "")


def names_of(section: str) -> list[str]:
    """Pictures of a section, as paths relative to the folder of the paper."""
    return list(CAPTIONS.index[CAPTIONS["section"] == section])


def picture(name: str, folder: Path) -> str:
    """A picture with its caption and anchor.

    Its minimum width on screen is such that text of size SMALLEST_FONT is SMALLEST_TEXT pixels high; on a narrower page
    the picture scrolls.
    """
    with Image.open(folder / name) as image:
        inches = image.width / float(image.info.get("dpi", (DPI, DPI))[0])
    least = math.ceil(inches * SMALLEST_TEXT * POINTS / SMALLEST_FONT)
    return f'![{markdown.literal(caption(name))}]({name}){{#{anchor(name)} style="--least: {least}px"}}'


SMALLEST_FONT, SMALLEST_TEXT = 8.0, 9.0  # points in the figures, pixels on the page
POINTS, DPI = 72.0, 200.0  # per inch; resolution of a picture without its own


def caption(name: str) -> str:
    """Caption from captions.csv, or the name of the file."""
    return CAPTIONS["caption"].get(name, Path(name).stem.replace("_", " "))


def anchor(name: str) -> str:
    """Target of links to a picture."""
    return "picture-" + re.sub(r"\W", "-", Path(name).stem)
