"""`./lab other-paths`: runs the campaign and writes results/other_paths, or rewrites it from the data set there."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

from analysis.campaigns import add_campaign_options, finished, save_figures, simulate, write_tables
from analysis.other_paths.collect import collect
from analysis.other_paths.engines import agreement, cycles_table, liquefaction_figure, read_curves
from analysis.other_paths.errors import REFERENCE, budget_table, comparison, error_table, form_table
from analysis.other_paths.figures import error_figure, rotation_figure, strength_figure
from analysis.other_paths.page import page
from analysis.other_paths.strength import end_table, mean_table, model_strength, strength_ratio
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_text
from labkit.model import Model

TESTS, ENGINES = (Path(__file__).with_name(name) for name in ("paths.yaml", "engines.yaml"))
DATA = "statistics.nc"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab other-paths`."""
    otherwise = "the tables and figures are written again from statistics.nc in the output folder"
    add_campaign_options(parser, "other_paths", otherwise)
    parser.add_argument("engines", nargs="?", help="folder of the campaign that compares the engines (default: none)")


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""
    code, folder = 0, Path(make_folder(options.output, "--output"))
    if options.campaign:
        if not options.as_is:
            code = simulate(options.campaign, options.cores, reporter("campaign"), TESTS)
        collect(finished(options.campaign), folder / DATA, command, reporter("statistics"))
    if options.engines:
        if not options.as_is:
            code = code or simulate(options.engines, options.cores, reporter("engines"), ENGINES)
        compare(finished(options.engines), folder, command, reporter("comparison"))
    if not (folder / DATA).exists():
        raise InputError(f"{folder} contains no {DATA}: give the folder of a campaign")
    for file in write(folder, command, reporter("tables")):
        print(file)
    return int(code != 0)


def compare(files: Sequence[Path], folder: Path, command: str, progress: Progress) -> None:
    """Writes engines.csv, liquefaction.csv and liquefaction.png from the runs that compare the engines."""
    tables = {"engines": agreement(read_curves(files, progress)), "liquefaction": cycles_table(files)}
    write_tables(tables, folder, files, command)
    save_figures({"liquefaction": liquefaction_figure(files)}, folder, files, command)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the data set in a folder; yields the files."""
    source = folder / DATA
    with xr.open_dataset(source) as opened:
        data = opened.load()
    data = data.set_coords(["test", "specimen"])
    progress(0.0, "errors of C0")
    errors, ends = error_table(data), end_table(data)
    tables = {
        "c0_errors": errors,
        "c0_forms": form_table(data),
        "c0_budget": budget_table(data),
        "c0_comparison": comparison(errors),
        "ends": ends,
        "strength": mean_table(ends),
    }
    progress(0.3, "model")
    start = data.sel(run=data["run"].values[data["test"].values == REFERENCE][0]).isel(point=0)
    b = np.linspace(0.0, 1.0, 11)
    model = Model().reading(beyond_e_cmax="flat")
    strength = model_strength(model, float(start["void_ratio_nominal"]), float(start["coordination_number"]), b)
    tables["model_strength"] = pandas.DataFrame({"b": b, "M": strength})
    yield from write_tables(tables, folder, [source], command)
    progress(0.7, "figures")
    figures = {
        "strength": strength_figure(ends, tables["strength"], {"b": b, "M": strength}),
        "c0_errors": error_figure(errors),
        "c0_components": rotation_figure(data),
    }
    yield from save_figures(figures, folder, [source], command)
    for name in ("engines", "liquefaction"):
        if (folder / f"{name}.csv").exists():
            tables[name] = pandas.read_csv(folder / f"{name}.csv")
    write_text(folder / "README.md", page(tables, strength_ratio(ends), command))
    yield folder / "README.md"
    progress(1.0, "done")
