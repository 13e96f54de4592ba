"""What the commands of the studies share: options, the campaign, and output files."""

from __future__ import annotations

import argparse
import gzip
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas
from matplotlib.figure import Figure

from analysis.pictures import save
from labkit.cli.arguments import positive_int
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.files import open_netcdf, whole_file, write_provenance, write_with_provenance
from labkit.plugins.campaigns import CAMPAIGN, RUNS, read_campaign, run_workflow, tell


def add_campaign_options(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """Adds `campaign`, --as-is and --cores. `otherwise`: what happens without a campaign folder."""
    parser.add_argument("campaign", nargs="?", help=f"campaign folder, created or resumed (default: none; {otherwise})")
    parser.add_argument("--as-is", action="store_true", help="run nothing; use the finished runs of the campaign")
    cores = "number of cores to use (default: all)"
    parser.add_argument("--cores", type=positive_int, default=os.cpu_count() or 1, help=cores)


def simulate(folder: str | Path, cores: int, progress: Progress, tests: Path) -> int:
    """Brings the campaign in `folder` up to date and returns its exit code.

    It uses the campaign file in the folder, or else `tests`.
    """
    folder = Path(folder)
    file = folder / CAMPAIGN if (folder / CAMPAIGN).exists() else tests
    text = file.read_text(encoding="utf-8")
    return tell(folder, run_workflow(read_campaign(file), text, folder, cores, progress=progress))


def finished(campaign: str | Path) -> list[Path]:
    """Return the files of the finished runs of the campaign in a folder. Raises InputError if it has none."""
    files = [file for file in sorted((Path(campaign) / RUNS).glob("*.run.nc")) if ended(file)]
    if not files:
        raise InputError(f"{campaign} contains no finished runs: give a folder in which the campaign was run")
    return files


def ended(file: Path) -> bool:
    """True if the run in a file is finished."""
    with open_netcdf(file, "run") as dataset:
        return bool(dataset.getncattr("complete")) or bool(getattr(dataset, "ended_because", ""))


def write_tables(
    tables: Mapping[str, pandas.DataFrame], folder: Path, sources: Sequence[str | Path], command: str, rounding: str
) -> list[Path]:
    """Writes each table as NAME.csv with its provenance; returns the files. `rounding`: format of the numbers."""
    for name, table in tables.items():
        text = table.to_csv(index=False, float_format=rounding)
        write_with_provenance(folder / f"{name}.csv", text, sources, command)
    return [folder / f"{name}.csv" for name in tables]


def write_compressed(
    table: pandas.DataFrame, file: Path, sources: Sequence[str | Path], command: str, rounding: str
) -> None:
    """Writes a large table as a compressed CSV file with its provenance; `rounding` as in write_tables."""
    text = table.to_csv(index=False, float_format=rounding)
    with whole_file(file) as temporary:
        temporary.write_bytes(gzip.compress(text.encode(), mtime=0))  # the same table gives the same bytes
    write_provenance(file, sources, command)


def save_figures(
    figures: Mapping[str, Figure], folder: Path, sources: Sequence[str | Path], command: str
) -> list[Path]:
    """Saves each figure as NAME.png with its provenance; returns the files."""
    for name, figure in figures.items():
        save(figure, folder / f"{name}.png", sources, command)
    return [folder / f"{name}.png" for name in figures]
