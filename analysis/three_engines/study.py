"""`./lab three-engines FOLDER`: runs the tests that are missing and writes results/three_engines."""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas

from analysis.campaigns import write_tables
from analysis.study import STEPS, Figures, StoredTables, Study, Values
from analysis.three_engines.compare import differences, figure, held, pooled, values
from analysis.three_engines.runs import OTHER, finished, simulate
from labkit.cli.arguments import positive_int
from labkit.errors import InputError
from labkit.io import make_folder, reporter


class ThreeEngines(Study):
    """Three engines on the same tests."""

    data, rounding = "values.csv", "%.6g"
    steps = tuple(step for step in STEPS if step != "tables")  # the rounded values do not determine the differences

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        folder = (
            "folder of the run files, created or continued (default: none; the figure and the page are written again)"
        )
        parser.add_argument("campaign", metavar="folder", nargs="?", help=folder)
        parser.add_argument("--as-is", action="store_true", help="run nothing; use the finished tests")
        grains = "numbers of grains (default: 1000)"
        parser.add_argument("--grains", type=positive_int, nargs="+", default=[1000], help=grains)
        seeds = "number of specimens of each size (default: 3)"
        parser.add_argument("--seeds", type=positive_int, default=3, help=seeds)
        more = "number of specimens of each size on fused, whose scatter is the measure (default: 5)"
        parser.add_argument("--on-fused", type=positive_int, default=5, help=more)
        self.add_output(parser)

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        """Runs the tests and writes the tables."""
        runs = Path(make_folder(options.campaign, "folder"))
        if "campaign" in options.steps and not options.as_is:
            simulate(runs, options.grains, options.seeds, options.on_fused, reporter("three-engines"))
        if "gather" in options.steps:
            tests = finished(runs)
            if not tests:
                raise InputError(f"{runs} contains no finished tests: leave out --as-is")
            measured = values(runs, tests)
            compared = {"differences": differences(measured), "pooled": pooled(measured)}
            tables = {"values": measured, "held": held(runs, tests), **compared}
            write_tables(tables, folder, [], command, self.rounding)
            print(*(table.to_string(index=False, float_format="%.4g") for table in compared.values()), sep="\n")
        return 0

    def figures(self, data: pandas.DataFrame, tables: StoredTables) -> Figures:
        return {"differences": figure(tables["differences"])}

    def numbers(self, tables: StoredTables) -> Values:
        runs = tables["values"]
        kinds = {"fused": runs["engine"] == "fused"} | {name: runs["engine"] == name for name in OTHER.values()}
        counts = {name: runs[kind].groupby("grains")["seed"].nunique() for name, kind in kinds.items()}
        held = tables["held"].pivot_table(index="engine", columns="path", values="stress_rms", aggfunc="max")
        return {
            "specimens": pandas.DataFrame(counts).fillna(0).astype(int).reset_index(),
            "held": (100.0 * held).reset_index(),
        }


STUDY = ThreeEngines()
