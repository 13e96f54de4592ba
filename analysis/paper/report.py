"""`./lab report`: results/paper and related results as one HTML page, from the template report.md.

Every number is read from a data file. For anything missing the page names the command that writes it.
"""

from __future__ import annotations

import argparse
import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas
from PIL import Image

from analysis import markdown
from analysis.manifest import collect
from analysis.pages import render
from analysis.paper.origins import provenance
from analysis.paper.report_numbers import (
    BENCH,
    PATHS,
    cost,
    fidelity,
    model_errors,
    model_medians,
    of_the_paper,
    run_list,
)
from analysis.paper.web_page import write_page
from analysis.places import results_folder
from analysis.speed_error.errors import errors
from analysis.speed_error.numbers import settings
from analysis.speed_error.table import open_study
from labkit.errors import InputError
from labkit.files import require_writable, write_provenance
from labkit.results import SFF_TOLERANCE, SHEAR

TABLES = "./lab paper"  # command that writes the tables and figures
TEMPLATE = Path(__file__).with_name("report.md")
CAPTIONS = pandas.read_csv(Path(__file__).with_name("captions.csv")).set_index("file")
STUDIED = ("study.nc", "settings.csv")
SMALLEST_FONT, SMALLEST_TEXT = 8.0, 9.0  # points in the figures, pixels on the page
POINTS, DPI = 72.0, 200.0  # pixels per inch of a picture that states no resolution


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab report`."""
    folder = "output folder of ./lab paper (default: results/paper)"
    parser.add_argument("folder", nargs="?", default=results_folder("paper"), help=folder)
    parser.add_argument("-o", "--output", help="HTML file (default: report.html in the folder)")


def main(options: argparse.Namespace, command: str) -> None:
    """Writes the report of a folder."""
    output = options.output or str(Path(options.folder) / "report.html")
    report(options.folder, output, command)
    if not options.output:
        collect(options.folder)
    print(f"page: {output}")


def report(folder: str | Path, output: str | Path, command: str) -> None:
    """Writes the report of a folder of `./lab paper` to the HTML file `output`, with a provenance file next to it.

    `command`: the command to record. Raises InputError without the folder or without pandoc.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: create it with {TABLES} CAMPAIGN -o {folder}")
    require_writable(output)
    files = shown_files(folder)
    values = numbers(folder) | {"provenance": provenance(folder, files, output, command)} | pieces(folder)
    write_page(render(TEMPLATE, values), folder, output)
    write_provenance(output, files, command)


def numbers(folder: Path) -> dict[str, Any]:
    """The values that the template names; None for those whose data file is missing."""

    def of(name: str, values: Callable[[pandas.DataFrame], Any] = pandas.DataFrame, **reading: Any) -> Any:
        file = folder / name
        return values(pandas.read_csv(file, **reading)) if file.is_file() else None

    there = [name for name in names_of("figures") if (folder / name).is_file()]
    speeds = of(f"../{BENCH}")
    return {
        **{name: of(f"{name}.csv") for name in ("campaign", "sff", "engines")},
        "hard_cases": of("../hard_cases/hard_cases.csv"),
        "medians": of("model_errors.csv", model_medians),
        **{"paths": PATHS, "shear": SHEAR, "limit": SFF_TOLERANCE, "of_the_paper": of_the_paper},
        "runs": run_list(folder),
        "fidelity": of("fidelity.csv", fidelity),
        "index": {re.sub(r"^(Fig\. \d+)?.*", r"\1", caption(name)) or name: anchor(name) for name in there},
        "model": of("model_errors.csv", model_errors),
        "recommended": recommended_settings(folder.parent / "speed_error"),
        "cost": of("campaign.csv", lambda runs: cost(runs, speeds), dtype_backend="numpy_nullable"),
    }


def pieces(folder: Path) -> dict[str, Callable[..., Any]]:
    """The functions that the template calls, in pandoc's Markdown."""
    unknown = sorted({file.name for file in folder.glob("*.png")} - set(CAPTIONS.index))
    return {
        "box": box,
        "boxed": lambda label, kind="", caller=None: box(caller().strip(), label, kind) + "\n",
        "shown": shown,
        "missing": missing,
        "exists": lambda name: (folder / name).is_file(),
        "csv": functools.partial(csv_table, folder),
        "pictures": lambda section, by=TABLES: pictures(folder, names_of(section), by),
        "other_pictures": lambda: pictures(folder, unknown, TABLES),
    }


def csv_table(
    folder: Path, name: str, label: str, columns: Mapping[str, str] | None = None, fold: bool = False, by: str = TABLES
) -> str:
    """A CSV file as a table, coloured by verdict; if it is missing, a note naming the command that writes it.

    columns: column -> heading of those that are shown; all if the file lacks one of them.
    """
    file = folder / name
    if not file.is_file():
        return missing(file.name, by)
    frame = pandas.read_csv(file, dtype_backend="numpy_nullable")
    over = frame["over"] if "over" in frame else ()  # number of records above a limit
    marks = ["" if pandas.isna(count) else "outside" if count else "inside" for count in over]
    if columns and set(columns) <= set(frame):
        frame = frame[list(columns)].rename(columns=columns)
    return shown(frame, label, fold, marks)


def shown(frame: pandas.DataFrame, label: str, fold: bool = False, marks: Sequence[str] = ()) -> str:
    """A pandas.DataFrame as a table, optionally collapsed. `marks`: for each row `inside`, `outside` or ""."""
    boxed = box(markdown.frame_table(frame, marks), label)
    return f"<details>\n<summary>{label}: {len(frame)} rows</summary>\n\n{boxed}\n\n</details>" if fold else boxed


def box(text: str, label: str, kind: str = "") -> str:
    """A Markdown table in a box that scrolls sideways, also with the keyboard, if it is wider than the page.

    `kind`: a further CSS class.
    """
    classes = ".table" + (f" .{kind}" if kind else "")
    return f'::: {{{classes} tabindex="0" role="region" aria-label="{label}"}}\n{text}\n:::'


def missing(what: str, by: str = TABLES) -> str:
    """A note on missing files and the command that writes them."""
    return f"::: missing\nMissing: {markdown.literal(what)}. Written by `{by}`.\n:::"


def pictures(folder: Path, names: Sequence[str], by: str) -> str:
    """Pictures, and a note naming the command that draws the missing ones."""
    absent = [Path(name).name for name in names if not (folder / name).is_file()]
    drawn = [picture(name, folder) for name in names if (folder / name).is_file()]
    return "\n\n".join([*drawn, *([missing(", ".join(absent), by)] if absent else [])])


def names_of(section: str) -> list[str]:
    """Pictures of a section, as paths relative to the folder of the paper."""
    return list(CAPTIONS.index[CAPTIONS["section"] == section])


def picture(name: str, folder: Path) -> str:
    """A picture with its caption and anchor.

    Its minimum width on screen makes text of size SMALLEST_FONT at least SMALLEST_TEXT pixels high; on a narrower
    page the picture scrolls.
    """
    with Image.open(folder / name) as image:
        inches = image.width / float(image.info.get("dpi", (DPI, DPI))[0])
    least = math.ceil(inches * SMALLEST_TEXT * POINTS / SMALLEST_FONT)
    return f'![{markdown.literal(caption(name))}]({name}){{#{anchor(name)} style="--least: {least}px"}}'


def caption(name: str) -> str:
    """Caption from captions.csv, or the name of the file."""
    return CAPTIONS["caption"].get(name, Path(name).stem.replace("_", " "))


def anchor(name: str) -> str:
    """Target of links to a picture."""
    return "picture-" + re.sub(r"\W", "-", Path(name).stem)


def recommended_settings(study: Path) -> dict[str, Any] | None:
    """The recommended settings along CP, from study.nc and settings.csv; None if one is missing."""
    if not all((study / name).is_file() for name in STUDIED):
        return None
    timed = pandas.read_csv(study / "settings.csv")
    with open_study(study / "study.nc") as data:
        return settings(data, errors(data, timed), timed, "cp")


def shown_files(folder: Path) -> list[Path]:
    """Data files and pictures shown on the page, sorted."""
    known = {folder / name for name in CAPTIONS.index} | set(folder.glob("*.png"))
    others = [folder.parent / "hard_cases/hard_cases.csv", folder.parent / BENCH]
    others += [folder.parent / "speed_error" / name for name in STUDIED]
    return sorted(file for file in {*known, *folder.glob("*.csv"), *others} if file.is_file())
