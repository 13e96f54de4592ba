"""Pieces of the report in pandoc's Markdown: tables of data files, pictures with captions, what is missing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pandas

from analysis import markdown

CAPTIONS = pandas.read_csv(Path(__file__).with_name("captions.csv")).set_index("file")
SHOWN = {  # file -> column -> heading, for files with more than people read
    "fidelity.csv": {
        "label": "number",
        "ours": "ours",
        "within": "± (95 %)",
        "paper_says": "paper",
        "in_units": "diff. / ±",
        "agrees": "agrees",
        "explanation": "explanation",
        "uncertainty_of": "± is of",
    },
    "fidelity_causes.csv": {
        "number": "number",
        "cause": "cause",
        "alternative": "alternative",
        "effect": "effect",
        "within": "± (95 %)",
        "matters": "matters",
        "tests": "tests",
        "difference": "difference",
        "difference_left": "difference left",
    },
    "sff.csv": {
        "run": "run",
        "path": "path",
        "records": "records",
        "worst": "worst error",
        "mean": "mean error",
        "over": "records over 2 %",
        "worst_strain": "worst at strain",
        "worst_p_MPa": "at p, MPa",
        "explanation": "explanation",
    },
}


def join(*parts: str) -> str:
    """Parts of a text, those that are not empty, as paragraphs."""
    return "\n\n".join(part for part in parts if part)


def csv_table(file: Path, label: str, command: str, fold: bool = False) -> str:
    """A CSV file as a table, coloured where it says what agrees; or a word on the command that makes it."""
    if not file.is_file():
        return missing(file.name, command)
    frame = pandas.read_csv(file, dtype_backend="numpy_nullable")
    shown, marks = SHOWN.get(file.name, {}), _marks(frame)
    if set(shown) <= set(frame):
        frame = frame[list(shown) or list(frame)].rename(columns=shown)
    return table(frame, label, fold, marks)


def table(frame: pandas.DataFrame, label: str, fold: bool = False, marks: Sequence[str] = ()) -> str:
    """A pandas.DataFrame, folded or not. `marks`: for each row `inside`, `outside` or ""."""
    boxed = box(markdown.frame_table(frame, marks), label)
    return f"<details>\n<summary>{label}: {len(frame)} rows</summary>\n\n{boxed}\n\n</details>" if fold else boxed


def _marks(frame):
    """`inside` or `outside` for every row of a table with a verdict or with a count of what is out of bounds."""
    if "agrees" in frame:
        return [{"yes": "inside", "no": "outside"}.get(verdict, "") for verdict in frame["agrees"]]
    if "over" in frame:
        return ["" if pandas.isna(count) else "outside" if count else "inside" for count in frame["over"]]
    return ()


def box(text: str, label: str) -> str:
    """A Markdown table in a box that scrolls sideways where it is wider than the page, with the keyboard too."""
    return f'::: {{.table tabindex="0" role="region" aria-label="{label}"}}\n{text}\n:::'


def missing(what: str, command: str) -> str:
    """A word on what is not there, and on the command that makes it."""
    return f"::: missing\nNot there yet: {markdown.literal(what)}, made by `{command}`.\n:::"


def pictures(section: str, folder: Path, command: str) -> str:
    """The pictures of a section, and a word on the command that makes those that are not there."""
    names = names_of(section)
    absent = [Path(name).name for name in names if not (folder / name).is_file()]
    there = [picture(name) for name in names if (folder / name).is_file()]
    return join(*there, missing(", ".join(absent), command) if absent else "")


def names_of(section: str) -> list[str]:
    """The pictures that belong to a section, by name relative to the folder of the paper."""
    return list(CAPTIONS.index[CAPTIONS["section"] == section])


def picture(name: str) -> str:
    """A picture with its caption and an anchor."""
    return f"![{markdown.literal(caption(name))}]({name}){{#{anchor(name)}}}"


def caption(name: str) -> str:
    """That of captions.csv, or the name of the file."""
    return CAPTIONS["caption"].get(name, Path(name).stem.replace("_", " "))


def anchor(name: str) -> str:
    """The target of links to a picture."""
    return "picture-" + re.sub(r"\W", "-", Path(name).stem)
