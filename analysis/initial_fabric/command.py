"""`./lab initial-fabric`: runs the campaign, or uses the stored data, and writes results/initial_fabric."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas
import xarray as xr

from analysis.campaigns import add_campaign_options, carry_out, save_figures, write_tables
from analysis.initial_fabric.figures import balance_figure, directions_figure, twins_figure
from analysis.initial_fabric.loading import DATA, collect
from analysis.initial_fabric.page import page
from analysis.initial_fabric.response import coordination_table, direction_table, response_table, twin_table
from analysis.initial_fabric.states import balance_table, state_table
from labkit.campaigns import read_campaign
from labkit.engines import Progress
from labkit.io import reporter, write_text

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
TITLE = "What an isotropic stress hides: initial fabric and coordination number"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab initial-fabric`."""
    otherwise = f"the tables and figures are written again from {DATA} in the output folder"
    add_campaign_options(parser, "initial_fabric", otherwise)


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""

    def gather(runs: Sequence[Path], file: Path) -> None:
        collect(runs, file, command, reporter("data"), TITLE)

    return carry_out(options, command, CAMPAIGN, DATA, gather, write)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the data in a folder; yields the files."""
    source = folder / DATA
    with xr.open_dataset(source) as opened:
        data = opened.load()
    progress(0.1, "states and responses")
    tables = tables_of(data)
    yield from write_tables(tables, folder, [source], command)
    progress(0.6, "figures")
    figures = {
        "balance": balance_figure(tables["states"]),
        "directions": directions_figure(data),
        "twins": twins_figure(data),
    }
    yield from save_figures(figures, folder, [source], command)
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, command))
    yield folder / "README.md"
    progress(1.0, "done")


def tables_of(data: xr.Dataset) -> dict[str, pandas.DataFrame]:
    """The tables of the study, by name."""
    states, response = state_table(data), response_table(data)
    return {
        "states": states,
        "balance": balance_table(states),
        "response": response,
        "directions": direction_table(response),
        "coordination": coordination_table(response),
        "twins": twin_table(response),
    }
