"""`./lab constants`: runs the campaign, or uses the stored curves, and writes results/constants."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas

from analysis.campaigns import add_campaign_options, finished, save_figures, simulate, write_tables
from analysis.constants.figures import changes_figure, lines_figure
from analysis.constants.materials import MEASURED, cells_of, constant_table, material_of, slope_table
from analysis.constants.page import page
from analysis.curves import CURVES, collect_curves, read_curves, window_means
from analysis.statistics import adjusted, paired_difference, stationarity_table
from analysis.statistics import slope_table as slopes_of
from labkit.campaign import read_campaign
from labkit.dem import Progress
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_text

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
TITLE = "The constants of Table 2 for other grains"
WINDOW = (0.35, 0.5)  # of strain; the state of a test is its mean there
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain
SLOW, FAST = "slow", "cv"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab constants`."""
    otherwise = f"the tables and figures are written again from {CURVES} in the output folder"
    add_campaign_options(parser, "constants", otherwise)


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""
    code, folder = 0, Path(make_folder(options.output, "--output"))
    if options.campaign:
        if not options.as_is:
            code = simulate(options.campaign, options.cores, reporter("campaign"), CAMPAIGN)
        collect_curves(finished(options.campaign), folder / CURVES, command, reporter("curves"), TITLE)
    if not (folder / CURVES).exists():
        raise InputError(f"{folder} contains no {CURVES}: give the folder of a campaign")
    for file in write(folder, command, reporter("tables")):
        print(file)
    return int(code != 0)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the curves in a folder; yields the files."""
    source = folder / CURVES
    curves = read_curves(source)
    progress(0.1, "states")
    ends = end_table(curves)
    of_rate_1 = ends[ends["test"] != SLOW]
    cells = cells_of(of_rate_1)
    tables = {
        "ends": ends,
        "constants": constant_table(cells),
        "slopes": slope_table(cells),
        "rate": rate_table(ends),
        "stationarity": drift_table(curves),
    }
    yield from write_tables(tables, folder, [source], command)
    progress(0.5, "figures")
    figures = {"lines": lines_figure(of_rate_1, cells), "changes": changes_figure(tables["constants"])}
    yield from save_figures(figures, folder, [source], command)
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, WINDOW, command))
    yield folder / "README.md"
    progress(1.0, "done")


def end_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """State of each test, its mean over WINDOW: run, test, specimen, grains, QUANTITIES, material, density."""
    ends = window_means(curves, *WINDOW)
    ends[["material", "density"]] = [material_of(specimen) for specimen in ends["specimen"]]
    return ends


def rate_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Differences between tests of the same specimens at I = 1e-3 and 2.5e-4, a row per quantity.

    Columns: quantity, mean (at 2.5e-4), difference (fast - slow), within, specimens, p_value, corrected (Holm).
    """
    slow = ends[ends["test"] == SLOW]
    both = ends[ends["specimen"].isin(slow["specimen"])]
    rows = []
    for quantity in MEASURED:
        found = paired_difference(both, quantity, "test", SLOW, FAST)
        rows.append(
            {
                "quantity": quantity,
                "mean": slow[quantity].mean(),
                "difference": found.value,
                "within": found.within,
                "specimens": found.n,
                "p_value": found.p_value,
            }
        )
    table = pandas.DataFrame(rows)
    table["corrected"] = adjusted(table["p_value"])
    return table


def drift_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """Slopes of MEASURED within WINDOW over all specimens, see analysis.statistics.stationarity_table."""
    tests = curves[curves["test"] != SLOW]
    return stationarity_table(slopes_of(tests, MEASURED, *WINDOW), judged=LIMITS)
