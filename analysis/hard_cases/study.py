"""`./lab hard-cases`: runs all cases on each engine, resumably; writes a table, a figure and a page."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import pandas

import labkit as lk
from analysis.campaigns import save_figures
from analysis.hard_cases.figure import draw
from analysis.hard_cases.outcome import Outcome, examine
from analysis.hard_cases.scenes import ENGINES, GRAINS, SCENES, SILENT_WRONG, HardScene
from analysis.study import StoredTables, Study, Values
from labkit.cli.arguments import positive_int
from labkit.engines import find_yade
from labkit.errors import InputError
from labkit.files import make_folder, write_text, write_with_provenance
from labkit.process import reporter
from labkit.specimens import side_for

SMALLEST_VOID_RATIO = 0.3


class HardCases(Study):
    """Scenarios in which a simulation may go wrong."""

    data = "hard_cases.csv"
    steps = ("page",)

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("name", nargs="*", help=f"cases to run: {', '.join(SCENES)} (default: all)")
        engine = "engine; mixed is fused in mixed precision (default: all)"
        parser.add_argument("--engine", choices=(*ENGINES, "all"), default="all", help=engine)
        grains = f"number of grains per specimen (default: {GRAINS})"
        parser.add_argument("--grains", type=positive_int, default=GRAINS, help=grains)
        work = "folder for the run files; finished cases there are not run again (default: hard_cases)"
        parser.add_argument("--work", default="hard_cases", help=work)
        super().add_options(parser)

    def main(self, options: argparse.Namespace, command: str) -> int:
        """Runs the cases or writes the page again; returns 1 if a case is silently wrong, else 0.

        Raises InputError for an unknown case or too few grains.
        """
        unknown = [name for name in options.name if name not in SCENES]
        if unknown:
            raise InputError(f"hard case {unknown[0]!r} is unknown: choose from {', '.join(SCENES)}")
        side_for(options.grains, SMALLEST_VOID_RATIO, lk.Scene())
        super().main(options, command)
        return int((StoredTables(Path(options.output))["hard_cases"]["verdict"] == SILENT_WRONG).any())

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        engines = list(ENGINES) if options.engine == "all" else [options.engine]
        if "yade" in engines:
            find_yade()
        names = list(dict.fromkeys(options.name or SCENES))
        work = Path(make_folder(options.work, "--work")) / f"n{options.grains}"
        outcomes, pairs, progress = [], [(name, engine) for engine in engines for name in names], reporter("hard cases")
        for done, (name, engine) in enumerate(pairs):
            progress(done / len(pairs), f"{name} on {engine}, {len(pairs) - done} remaining")
            outcomes.append(_examined(SCENES[name], engine, options.grains, work))
        progress(1.0, "done")
        outcomes.sort(key=lambda outcome: names.index(outcome.case))
        table = pandas.DataFrame([dataclasses.asdict(outcome) for outcome in outcomes])
        print(table[["case", "engine", "verdict", "checks", "seconds", "failed"]].to_string(index=False))
        write_with_provenance(folder / self.data, table.to_csv(index=False, float_format="%.6g"), command=command)
        figure = draw(work, engines, names)
        if figure is not None:
            save_figures({"hard_cases": figure}, folder, [], command)
        return 0

    def numbers(self, tables: StoredTables) -> Values:
        table = tables["hard_cases"]
        text = ["did", "failed", "guard"]
        table[text] = table[text].astype(object).fillna("").map(lambda words: words.replace(" | ", "; ").rstrip("."))
        return {
            "outcomes": table.assign(
                failed=[f" **Failed: {words}.**" * bool(words) for words in table["failed"]],
                guard=table["guard"].replace("", "none"),
            ),
            "drawn": (tables.folder / "hard_cases.png").exists(),
        }


STUDY = HardCases()


def _examined(scene: HardScene, engine: str, grains: int, folder: Path) -> Outcome:
    """Outcome of a case: the stored one from the work folder if it belongs to the same scene, otherwise a new one."""
    place = folder / engine / scene.name
    file, as_json = place / "outcome.json", json.loads(json.dumps(dataclasses.asdict(scene)))
    if file.exists():
        kept = json.loads(file.read_text())
        if kept["scene"] == as_json:
            return Outcome(**kept["outcome"])
    outcome = examine(scene, engine, grains, 1.0, place, folder / "shared")
    write_text(file, json.dumps({"scene": as_json, "outcome": dataclasses.asdict(outcome)}, indent=1))
    return outcome
