"""`./lab critical-state`: runs the campaign, or uses the stored data set, and writes results/critical_state."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import xarray as xr

from analysis.campaigns import add_campaign_options, carry_out, save_figures, write_tables
from analysis.critical_state.ends import end_table, records
from analysis.critical_state.figures import drift_figure, lines_figure, lode_figure
from analysis.critical_state.page import page
from analysis.critical_state.questions import by_lode_angle, lines, offsets, one_critical_state, stationarity
from analysis.other_paths.collect import collect
from labkit.campaigns import read_campaign
from labkit.engines import Progress
from labkit.io import reporter, write_text

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
DATA = "statistics.nc"
TITLE = "The critical state at large strain"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab critical-state`."""
    otherwise = "the tables and figures are written again from statistics.nc in the output folder"
    add_campaign_options(parser, "critical_state", otherwise)


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""

    def gather(runs: Sequence[Path], file: Path) -> None:
        collect(runs, file, command, reporter("statistics"), TITLE)

    return carry_out(options, command, CAMPAIGN, DATA, gather, write)


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
    yield from write_tables(tables, folder, [source], command)
    progress(0.7, "figures")
    figures = {
        "drift": drift_figure(table),
        "lines": lines_figure(ends),
        "lode_angle": lode_figure(tables["by_lode_angle"], ends),
    }
    yield from save_figures(figures, folder, [source], command)
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, command))
    yield folder / "README.md"
    progress(1.0, "done")
