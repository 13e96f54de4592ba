"""`./lab hard-cases`: all of them on each engine, resumable; a table, a figure and a page."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import pandas

import labkit as lk
from analysis.hard_cases.figure import draw
from analysis.hard_cases.outcome import Outcome, examine
from analysis.hard_cases.page import page, table
from analysis.hard_cases.scenes import GRAINS, SCENES, SILENT_WRONG
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.dem import Progress, side_for
from labkit.engines import find_yade
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_text, write_with_provenance
from labkit.visuals import plots

ENGINES = ("yade", "fused")
SMALLEST_VOID_RATIO = 0.3


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of `./lab hard-cases`."""
    parser.add_argument("name", nargs="*", help=f"which ones: {', '.join(SCENES)} (default: all)")
    parser.add_argument("--engine", choices=(*ENGINES, "both"), default="both", help="(default: both)")
    parser.add_argument("--grains", type=positive_int, default=GRAINS, help=f"of a specimen (default: {GRAINS})")
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("hard_cases"),
        help="folder of the page, the table and the figure (default: results/hard_cases)",
    )
    parser.add_argument(
        "--work",
        default="hard_cases",
        help="folder of the run files; finished cases there are not run again (default: hard_cases)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the cases; 1 if one is silently wrong."""
    engines = ENGINES if options.engine == "both" else (options.engine,)
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

    `work`: folder of the run files, where finished cases are kept; `history`: the command that makes the page. Returns
    1 if a case is silently wrong, else 0. Raises InputError for names, grains or folders that
    cannot be.
    """
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        raise InputError(f"hard case {unknown[0]!r} is unknown: use {', '.join(SCENES)}")
    side_for(grains, SMALLEST_VOID_RATIO, lk.Scene())
    folder, output = make_folder(work, "--work") / f"n{grains}", make_folder(output, "--output")
    names = list(dict.fromkeys(names))
    outcomes, all_ = [], [(engine, name) for engine in engines for name in names]
    for done, (engine, name) in enumerate(all_):
        progress(done / len(all_), f"{name} on {engine}, {len(all_) - done} to do")
        outcomes.append(_examined(SCENES[name], engine, grains, folder))
    progress(1.0, "done")
    outcomes.sort(key=lambda outcome: names.index(outcome.case))
    print(table(outcomes))
    frame = pandas.DataFrame([dataclasses.asdict(outcome) for outcome in outcomes])
    write_with_provenance(output / "hard_cases.csv", frame.to_csv(index=False, float_format="%.4g"), command=history)
    drawn = draw(folder, engines, names)
    if drawn is not None:
        plots.save(drawn, output / "hard_cases.png", command=history)
    write_with_provenance(output / "README.md", page(outcomes, grains, history, drawn is not None), command=history)
    print(f"page: {output / 'README.md'}")
    return int(any(outcome.verdict == SILENT_WRONG for outcome in outcomes))


def _examined(scene, engine, grains, folder):
    """The Outcome of a case: that in the work folder if it is of the same scene, else a new one, kept there."""
    place = folder / engine / scene.name
    kept, of = place / "outcome.json", json.loads(json.dumps(dataclasses.asdict(scene)))
    if kept.exists():
        found = json.loads(kept.read_text())
        if found["scene"] == of:
            return Outcome(**found["outcome"])
    outcome = examine(scene, engine, grains, 1.0, place, folder / "shared")
    write_text(kept, json.dumps({"scene": of, "outcome": dataclasses.asdict(outcome)}, indent=1))
    return outcome
