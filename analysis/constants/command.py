"""`./lab constants`: runs the campaign, or uses the stored curves, and writes results/constants."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas
import xarray as xr

from analysis.campaigns import add_campaign_options, carry_out, save_figures, write_tables
from analysis.constants.figures import changes_figure, lines_figure
from analysis.constants.materials import (
    CONSTANTS,
    DENSITIES,
    MEASURED,
    PAPER,
    Cells,
    cells_of,
    constant_table,
    constants,
    freedom_of,
    material_of,
    slope_table,
    tested,
    with_variance,
)
from analysis.constants.page import page
from analysis.curves import (
    AT_FULL_STRAIN,
    CURVES,
    collect_curves,
    curves_at_full_strain,
    read_curves,
    window_means,
)
from analysis.places import results_folder
from analysis.statistics import adjusted, stationarity_table
from analysis.statistics import slope_table as slopes_of
from labkit.campaigns import read_campaign
from labkit.engines import Progress
from labkit.io import reporter, write_text

CAMPAIGN = Path(__file__).with_name("campaign.yaml")
TITLE = "The constants of Table 2 for other grains"
WINDOW = (0.35, 0.5)  # of strain; the state of a test is its mean there
LIMITS = {"Lambda": 1e-4, "e": 1e-3}  # smallest slopes that matter, per 0.1 of strain
SLOW = "slow"  # tests of Table 1's grains that results/critical_state has stored: material, and beginning of the names
SLOW_TESTS = {f"cv-{density}-s{seed}": 4000 for density in DENSITIES for seed in range(1, 6)}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab constants`."""
    otherwise = f"the tables and figures are written again from {CURVES} in the output folder"
    add_campaign_options(parser, "constants", otherwise)


def main(options: argparse.Namespace, command: str) -> int:
    """Runs the campaign if one is given and writes all results; returns 1 if a run failed."""

    def gather(runs: Sequence[Path], file: Path) -> None:
        collect_curves(runs, file, command, reporter("curves"), TITLE, *slow_curves(Path(results_folder())))

    return carry_out(options, command, CAMPAIGN, CURVES, gather, write)


def write(folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the tables, the figures and the page from the curves in a folder; yields the files."""
    source = folder / CURVES
    progress(0.0, "tables")
    tables = tables_of(read_curves(source))
    yield from write_tables(tables, folder, [source], command)
    progress(0.5, "figures")
    ends = tables["ends"]
    figures = {
        "lines": lines_figure(ends, cells_of(ends[ends["material"] != SLOW])),
        "changes": changes_figure(tables["constants"]),
    }
    yield from save_figures(figures, folder, [source], command)
    planned = len(read_campaign(CAMPAIGN).runs)
    write_text(folder / "README.md", page(tables, planned, WINDOW, command))
    yield folder / "README.md"
    progress(1.0, "done")


def tables_of(curves: pandas.DataFrame) -> dict[str, pandas.DataFrame]:
    """The tables of the study, by name."""
    ends = end_table(curves)
    slow = ends["material"] == SLOW
    cells = cells_of(ends[~slow])
    return {
        "ends": ends,
        "constants": constant_table(cells),
        "slopes": slope_table(cells),
        "rate": rate_table(cells, cells_of(ends[slow])),
        "stationarity": drift_table(curves),
    }


def end_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """State of each test, its mean over WINDOW: run, test, specimen, grains, QUANTITIES, material, density."""
    ends = window_means(curves, *WINDOW)
    ends[["material", "density"]] = [material_of(specimen) for specimen in ends["specimen"]]
    return ends


def slow_curves(results: Path) -> tuple[dict[str, xr.Dataset], list[Path]]:
    """Curves of stored slow tests of Table 1's grains, by name (`slow-slow_dense-s1`), and the file they are from."""
    known = curves_at_full_strain(results, SLOW_TESTS, WINDOW[1])
    curves = {name.replace("cv-", f"{SLOW}-{SLOW}_"): data for name, data in known.items()}
    return curves, [results / AT_FULL_STRAIN] * bool(curves)


def rate_table(cells: Cells, slow: Cells) -> pandas.DataFrame:
    """Constants of Table 1's grains here minus those of the stored slow tests, a row per constant.

    Columns: constant, slow, difference, within, specimens (of both), p_value, corrected (Holm).
    """
    rows = []
    for material, pair in slow.items():
        here, there = with_variance(cells[PAPER], constants), with_variance(slow[material], constants)
        n = sum(cell.specimens for cell in (*cells[PAPER], *pair))
        for k, constant in enumerate(CONSTANTS):
            found = tested(here[0][k] - there[0][k], here[1][k] + there[1][k], freedom_of(slow), n)
            rows.append(
                {
                    "constant": constant,
                    "slow": there[0][k],
                    "difference": found.value,
                    "within": found.within,
                    "specimens": found.n,
                    "p_value": found.p_value,
                }
            )
    table = pandas.DataFrame(rows, columns=["constant", "slow", "difference", "within", "specimens", "p_value"])
    table["corrected"] = adjusted(table["p_value"])
    return table


def drift_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """Slopes of MEASURED within WINDOW over all specimens, see analysis.statistics.stationarity_table."""
    tests = curves[curves["test"] != SLOW]
    return stationarity_table(slopes_of(tests, MEASURED, *WINDOW), judged=LIMITS)
