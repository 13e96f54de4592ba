"""`./lab hard-cases`: runs all cases on each engine, resumably; writes a table, a figure and a page."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas

import labkit as lk
from analysis.hard_cases.figure import draw
from analysis.hard_cases.measures import MEASURED
from analysis.hard_cases.outcome import Outcome, examine
from analysis.hard_cases.page import page, table
from analysis.hard_cases.scenes import ENGINES, GRAINS, SCENES, SILENT_WRONG, HardScene
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.engines import Progress, find_yade
from labkit.errors import InputError
from labkit.figures import plots
from labkit.io import make_folder, provenance_of, reporter, write_text, write_with_provenance
from labkit.specimens import side_for

SMALLEST_VOID_RATIO = 0.3


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab hard-cases`."""
    parser.add_argument("name", nargs="*", help=f"cases to run: {', '.join(SCENES)} (default: all)")
    parser.add_argument(
        "--engine",
        choices=(*ENGINES, "all"),
        default="all",
        help="engine; mixed is fused in mixed precision (default: all)",
    )
    parser.add_argument(
        "--grains", type=positive_int, default=GRAINS, help=f"number of grains per specimen (default: {GRAINS})"
    )
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("hard_cases"),
        help="folder for the page, the table and the figure (default: results/hard_cases)",
    )
    parser.add_argument(
        "--redraw",
        action="store_true",
        help="run nothing: write the page again from the table in the output folder",
    )
    parser.add_argument(
        "--work",
        default="hard_cases",
        help="folder for the run files; finished cases there are not run again (default: hard_cases)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the cases or rewrites the page; returns 1 if a case is silently wrong, else 0."""
    if options.redraw:
        return redraw(options.output)
    engines = tuple(ENGINES) if options.engine == "all" else (options.engine,)
    if "yade" in engines:
        find_yade()
    names, progress = options.name or list(SCENES), reporter("hard cases")
    return study(names, engines, options.grains, options.output, options.work, progress, command)


def study(
    names: Sequence[str],
    engines: Sequence[str],
    grains: int,
    output: str | Path,
    work: str | Path,
    progress: Progress,
    history: str,
) -> int:
    """Runs the named scenes on the engines and writes hard_cases.csv, hard_cases.png and README.md to `output`.

    `work` is the folder for the run files, where finished cases are kept, and `history` the command that makes the
    page. Returns 1 if a case is silently wrong, else 0. Raises InputError for invalid names, numbers of grains or
    folders.
    """
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        raise InputError(f"hard case {unknown[0]!r} is unknown: choose from {', '.join(SCENES)}")
    side_for(grains, SMALLEST_VOID_RATIO, lk.Scene())
    folder = Path(make_folder(work, "--work")) / f"n{grains}"
    output = Path(make_folder(output, "--output"))
    names = list(dict.fromkeys(names))
    outcomes, pairs = [], [(engine, name) for engine in engines for name in names]
    for done, (engine, name) in enumerate(pairs):
        progress(done / len(pairs), f"{name} on {engine}, {len(pairs) - done} remaining")
        outcomes.append(_examined(SCENES[name], engine, grains, folder))
    progress(1.0, "done")
    outcomes.sort(key=lambda outcome: names.index(outcome.case))
    print(table(outcomes))
    frame = pandas.DataFrame([dataclasses.asdict(outcome) for outcome in outcomes])
    write_with_provenance(output / "hard_cases.csv", frame.to_csv(index=False, float_format="%.6g"), command=history)
    drawn = draw(folder, engines, names)
    if drawn is not None:
        plots.save(drawn, output / "hard_cases.png", command=history)
    write_with_provenance(output / "README.md", page(outcomes, grains, history, drawn is not None), command=history)
    print(f"page: {output / 'README.md'}")
    return int(any(outcome.verdict == SILENT_WRONG for outcome in outcomes))


def redraw(output: str | Path) -> int:
    """Writes README.md again from hard_cases.csv in the same folder; returns 1 if a case is silently wrong, else 0.

    Raises InputError if the folder does not hold hard_cases.csv.
    """
    folder, file = Path(output), Path(output) / "hard_cases.csv"
    if not file.exists():
        raise InputError(f"{folder} lacks hard_cases.csv: give the output folder (-o) of a finished ./lab hard-cases")
    frame = pandas.read_csv(file, keep_default_na=False, na_values={name: [""] for name in MEASURED}).astype(object)
    rows: list[dict[Any, Any]] = frame.where(frame.notna(), None).to_dict("records")
    outcomes = [Outcome(**row) for row in rows]
    written = provenance_of(file) or {}
    history, drawn = str(written.get("command", "./lab hard-cases")), (folder / "hard_cases.png").exists()
    write_with_provenance(
        folder / "README.md", page(outcomes, outcomes[0].grains, history, drawn), [file], "./lab hard-cases --redraw"
    )
    print(f"page: {folder / 'README.md'}")
    return int(any(outcome.verdict == SILENT_WRONG for outcome in outcomes))


def _examined(scene: HardScene, engine: str, grains: int, folder: Path) -> Outcome:
    """Outcome of a case: the one kept in the work folder if it belongs to the same scene, else a new one."""
    place = folder / engine / scene.name
    file, as_json = place / "outcome.json", json.loads(json.dumps(dataclasses.asdict(scene)))
    if file.exists():
        kept = json.loads(file.read_text())
        if kept["scene"] == as_json:
            return Outcome(**kept["outcome"])
    outcome = examine(scene, engine, grains, 1.0, place, folder / "shared")
    write_text(file, json.dumps({"scene": as_json, "outcome": dataclasses.asdict(outcome)}, indent=1))
    return outcome
