"""`./lab size-scatter`: runs the campaign, or uses the stored curves, and writes results/size_scatter."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas

from analysis.campaigns import add_campaign_options, carry_out, save_figures, write_tables
from analysis.curves import CURVES, collect_curves, read_curves, window_means
from analysis.paper.estimates import two_samples
from analysis.places import results_folder
from analysis.size_scatter.c0_error import c0_table
from analysis.size_scatter.figures import drift_figure, sizes_figure
from analysis.size_scatter.page import page
from analysis.size_scatter.sizes import MEASURED, bias_table, scatter_table, size_table
from analysis.size_scatter.stored import PREFIX, stored_curves
from analysis.statistics import adjusted, slope_table, stationarity_table
from labkit.campaigns import read_campaign
from labkit.engines import Progress
from labkit.io import reporter, write_text

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
TITLE = "Scatter and bias against the number of grains"
WINDOW = (0.3, 0.4)  # of strain; the state of a test is its mean there
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab size-scatter`."""
    otherwise = f"the tables and figures are written again from {CURVES} in the output folder"
    add_campaign_options(parser, "size_scatter", otherwise)


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""

    def gather(runs: Sequence[Path], file: Path) -> None:
        collect_curves(runs, file, command, reporter("curves"), TITLE, *stored_curves(Path(results_folder())))

    return carry_out(options, command, CAMPAIGN, CURVES, gather, write)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the curves in a folder; yields the files."""
    source = folder / CURVES
    curves = sized_curves(source)
    progress(0.2, "scatter and bias")
    tables = tables_of(curves)
    yield from write_tables(tables, folder, [source], command)
    progress(0.6, "figures")
    figures = {
        "drift": drift_figure(curves, WINDOW),
        "sizes": sizes_figure(tables["ends"], tables["sizes"], tables["scatter"]),
    }
    yield from save_figures(figures, folder, [source], command)
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, WINDOW, command))
    yield folder / "README.md"
    progress(1.0, "done")


def sized_curves(source: Path) -> pandas.DataFrame:
    """The curves of a data set with their size, the name of the specimens, from few to many grains."""
    curves = read_curves(source)
    curves["size"] = [specimen.partition("-")[0] for specimen in curves["specimen"]]
    return curves.sort_values("grains", kind="stable", ignore_index=True)


def tables_of(curves: pandas.DataFrame) -> dict[str, pandas.DataFrame]:
    """The tables of the study, by name."""
    ends = end_table(curves)
    sizes = size_table(ends)
    return {
        "c0_error": c0_table(curves),
        "ends": ends,
        "sizes": sizes,
        "scatter": scatter_table(sizes),
        "bias": bias_table(ends),
        "stored": stored_table(ends),
        "stationarity": stationarity_table(slope_table(curves, MEASURED, *WINDOW), judged=LIMITS),
    }


def stored_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Stored tests against those of the campaign with about as many grains (4,000), a row per quantity.

    Columns: quantity, mean (of the stored ones), difference (campaign minus stored, Welch), within, specimens, p_value,
    corrected (Holm).
    """
    both = ends[ends["size"] == "n4000"]
    slow = both["test"] == PREFIX
    rows = []
    for quantity in MEASURED:
        found = two_samples(lambda table, q=quantity: float(table[q].mean()), both[slow], both[~slow])  # type: ignore[misc]
        rows.append(
            {
                "quantity": quantity,
                "mean": both.loc[slow, quantity].mean(),
                "difference": found.value,
                "within": found.within,
                "specimens": found.n,
                "p_value": found.p_value,
            }
        )
    table = pandas.DataFrame(rows)
    table["corrected"] = adjusted(table["p_value"])
    return table


def end_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """State of each test, its mean over WINDOW: run, test, specimen, grains, QUANTITIES, size."""
    ends = window_means(curves, *WINDOW)
    ends["size"] = [specimen.partition("-")[0] for specimen in ends["specimen"]]
    return ends
