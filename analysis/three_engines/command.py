"""`./lab three-engines FOLDER`: runs the tests that are missing and writes results/three_engines."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import pandas

from analysis.pages import render
from analysis.places import results_folder
from analysis.statistics import SIGNIFICANT
from analysis.three_engines.compare import differences, figure, held, pooled, values
from analysis.three_engines.runs import OTHER, finished, simulate
from labkit.cli.arguments import positive_int
from labkit.errors import InputError
from labkit.figures import plots
from labkit.io import make_folder, reporter, write_with_provenance

NAMES = {"lammps": "LAMMPS", "yade": "YADE"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab three-engines`."""
    parser.add_argument("folder", help="folder of the run files, created or continued")
    parser.add_argument("--as-is", action="store_true", help="run nothing; use the finished tests")
    parser.add_argument(
        "--grains", type=positive_int, nargs="+", default=[1000], help="numbers of grains (default: 1000)"
    )
    parser.add_argument("--seeds", type=positive_int, default=3, help="number of specimens of each size (default: 3)")
    more = "number of specimens of each size on fused, whose scatter is the measure (default: 5)"
    parser.add_argument("--on-fused", type=positive_int, default=5, help=more)
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("three_engines"),
        help="folder for the results (default: results/three_engines)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the tests and writes tables and figure."""
    folder, output = Path(make_folder(options.folder, "folder")), Path(make_folder(options.output, "--output"))
    if not options.as_is:
        simulate(folder, options.grains, options.seeds, options.on_fused, reporter("three-engines"))
    tests = finished(folder)
    if not tests:
        raise InputError(f"{folder} contains no finished tests: leave out --as-is")
    measured = values(folder, tests)
    compared, of_all = differences(measured), pooled(measured)
    tables = {"values": measured, "differences": compared, "pooled": of_all, "held": held(folder, tests)}
    for name, table in tables.items():
        text = table.to_csv(index=False, float_format="%.6g")
        write_with_provenance(output / f"{name}.csv", text, command=command)
    plots.save(figure(compared), output / "differences.png", command=command)
    write_with_provenance(output / "README.md", page(tables), command=command)
    print(compared.to_string(index=False, float_format="%.4g"))
    print(of_all.to_string(index=False, float_format="%.4g"))
    return 0


def page(tables: Mapping[str, pandas.DataFrame]) -> str:
    """README.md of the study."""
    runs, of_all = tables["values"], tables["pooled"]
    kinds = {"fused": runs["engine"] == "fused"} | {name: runs["engine"] == name for name in OTHER.values()}
    counts = {name: runs[kind].groupby("grains")["seed"].nunique() for name, kind in kinds.items()}
    held = tables["held"].pivot_table(index="engine", columns="path", values="stress_rms", aggfunc="max")
    resolved = of_all[of_all["corrected"] <= SIGNIFICANT]
    found = {name: list(resolved["quantity"][resolved["engine"] == name]) for name in of_all["engine"].unique()}
    values = {
        "tables": tables,
        "specimens": pandas.DataFrame(counts).fillna(0).astype(int).reset_index(),
        "resolved": {NAMES[name]: quantities for name, quantities in found.items()},
        "held": (100.0 * held).reset_index(),
    }
    return render(Path(__file__).with_name("page.md"), values)
