"""`./lab critical-state`: runs the campaign, or uses the stored data set, and writes results/critical_state."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from analysis.critical_state.ends import end_table, records
from analysis.critical_state.figures import drift_figure, lines_figure, lode_figure
from analysis.critical_state.page import page
from analysis.critical_state.questions import by_lode_angle, lines, offsets, one_critical_state, stationarity
from analysis.other_paths.collect import collect
from analysis.paper.command import finished, simulate
from analysis.places import results_folder
from labkit.campaign import read_campaign
from labkit.cli.arguments import positive_int
from labkit.dem import Progress
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_text, write_with_provenance
from labkit.visuals import plots

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
DATA = "statistics.nc"
TITLE = "The critical state at large strain"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab critical-state`."""
    parser.add_argument(
        "campaign",
        nargs="?",
        help="campaign folder, created or resumed (default: none; the tables and figures are written again from "
        "statistics.nc in the output folder)",
    )
    parser.add_argument("--as-is", action="store_true", help="run nothing; use the finished runs of the campaign")
    parser.add_argument(
        "--cores", type=positive_int, default=os.cpu_count() or 1, help="number of cores to use (default: all)"
    )
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("critical_state"),
        help="folder for the results (default: results/critical_state)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""
    code, folder = 0, Path(make_folder(options.output, "--output"))
    if options.campaign:
        if not options.as_is:
            code = simulate(options.campaign, options.cores, reporter("campaign"), CAMPAIGN)
        collect(finished(options.campaign), folder / DATA, command, reporter("statistics"), TITLE)
    if not (folder / DATA).exists():
        raise InputError(f"{folder} contains no {DATA}: give the folder of a campaign")
    for file in write(folder, command, reporter("tables")):
        print(file)
    return int(code != 0)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the data set in a folder; yields the files."""
    source = folder / DATA
    with xr.open_dataset(source) as opened:
        data = opened.load()
    progress(0.0, "ends of the tests")
    table = records(data)
    ends = end_table(data, table)
    tables = {"ends": ends, "stationarity": stationarity(table), "by_lode_angle": by_lode_angle(ends)}
    progress(0.3, "one critical state")
    tables |= {"one_critical_state": one_critical_state(ends), "lines": lines(ends), "offsets": offsets(ends)}
    for name, rows in tables.items():
        file = folder / f"{name}.csv"
        write_with_provenance(file, rows.to_csv(index=False, float_format="%.5g"), [source], command)
        yield file
    progress(0.7, "figures")
    figures = {
        "drift": drift_figure(table),
        "lines": lines_figure(ends),
        "lode_angle": lode_figure(tables["by_lode_angle"], ends),
    }
    for name, figure in figures.items():
        plots.save(figure, folder / f"{name}.png", [source], command)
        yield folder / f"{name}.png"
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, command))
    yield folder / "README.md"
    progress(1.0, "done")
