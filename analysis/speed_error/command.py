"""`./lab speed-error`: runs or resumes a study and writes its data, figures and page."""

from __future__ import annotations

import argparse
import os
import shutil
import signal
from collections.abc import Mapping
from pathlib import Path
from types import FrameType

import pandas
import xarray as xr

from analysis.netcdf import characters
from analysis.places import results_folder
from analysis.speed_error import figures
from analysis.speed_error.design import DESIGNS
from analysis.speed_error.errors import errors
from analysis.speed_error.jobs import run_study
from analysis.speed_error.measures import MEASURES, measure_others
from analysis.speed_error.page import page
from analysis.speed_error.table import collect, open_study, restore
from labkit.cli.arguments import positive_int
from labkit.engines import Progress, find_yade
from labkit.errors import InputError, Interrupted
from labkit.figures import plots
from labkit.io import make_folder, reporter, whole_file, write_provenance, write_with_provenance


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab speed-error`."""
    parser.add_argument(
        "--design",
        choices=("full", "small"),
        default="full",
        help="full takes hours, small a minute with shorter tests of fewer grains (default: full)",
    )
    parser.add_argument(
        "--work",
        help="folder of specimens and runs, from which an interrupted study resumes "
        "(default: speed_error_full or speed_error_small)",
    )
    parser.add_argument(
        "--from", dest="earlier", help="study.nc of an earlier study; tests it already contains are not run again"
    )
    parser.add_argument("--jobs", type=positive_int, help="number of simultaneous runs (default: number of cores)")
    parser.add_argument(
        "--redraw",
        action="store_true",
        help="run nothing: draw the figures and write the page again from the data in the output folder",
    )
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("speed_error"),
        help="folder for the results (default: results/speed_error)",
    )


def main(options: argparse.Namespace, command: str) -> None:
    """Runs the study, or redraws a finished one, and prints the names of its files."""
    if options.redraw:
        files = redraw(options.output)
    else:
        find_yade()
        work = options.work or f"speed_error_{options.design}"
        jobs = options.jobs or os.cpu_count() or 1
        progress = reporter("speed-error")
        handler = signal.signal(signal.SIGINT, _interrupt_once)
        try:
            files = speed_error(options.design, work, options.output, jobs, progress, options.earlier)
        except (KeyboardInterrupt, Interrupted):
            raise Interrupted(f"interrupted; the same command resumes the study in {work}", 130) from None
        signal.signal(signal.SIGINT, handler)
    for file in files:
        print(file)


def _interrupt_once(number: int, frame: FrameType | None) -> None:
    """Raises KeyboardInterrupt; further signals are ignored while the worker processes end."""
    signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def speed_error(
    design_name: str,
    work: str | Path,
    output: str | Path,
    jobs: int,
    progress: Progress,
    earlier: str | Path | None = None,
) -> list[Path]:
    """Runs the design in the folder `work` and writes the folder `output`; returns the files in it.

    `earlier`: study.nc of an earlier study; tests it already contains are not run again.
    """
    design = DESIGNS[design_name]()
    if earlier:
        with open_study(earlier) as data:
            restore(data, design, work)
    folder = make_folder(output, "--output")
    run_study(design, work, jobs, progress)
    measures = measure_others(design, work, progress)
    command = f"./lab speed-error --design {design_name}"
    data = collect(design, work)
    data.attrs["command"] = command
    with whole_file(folder / "study.nc") as temporary:
        data.to_netcdf(temporary, encoding=characters(data))
    write_provenance(folder / "study.nc", command=command)
    for file in sorted((Path(work) / "measures").iterdir()):
        shutil.copyfile(file, folder / file.name)
        if file.suffix != ".png":
            write_provenance(folder / file.name, command=command)
    return write(data, measures, folder, command)


def redraw(output: str | Path) -> list[Path]:
    """Writes the tables, figures and page of the finished study in a folder again, from its data; returns its files.

    Raises InputError if the folder does not hold a study.
    """
    folder = Path(output)
    with open_study(folder / "study.nc") as data:
        files = {name: folder / f"{name}.csv" for name in MEASURES}
        measures = {name: pandas.read_csv(file) for name, file in files.items() if file.exists()}
        if "settings" not in measures:
            raise InputError(f"{folder} lacks settings.csv: give the output folder (-o) of a finished study")
        return write(data.load(), measures, folder, data.attrs.get("command", "./lab speed-error"))


def write(data: xr.Dataset, measures: Mapping[str, pandas.DataFrame], output: Path, command: str) -> list[Path]:
    """Writes the table of errors, the figures and the page of a finished study; returns all files of the folder."""
    table = errors(data, measures["settings"])
    study = [output / "study.nc"]
    text = table.to_csv(index=False, float_format="%.5g")
    write_with_provenance(output / "errors.csv", text, study, command)
    drawn = {
        "pareto_cp.png": figures.pareto(table),
        "pareto_cv.png": figures.pareto(table, "cv"),
        "changes.png": figures.changes(table),
        "sizes.png": figures.sizes(table),
    }
    for name, figure in drawn.items():
        plots.save(figure, output / name, study, command, figures.DPI)
    sources = [*study, output / "errors.csv"]
    write_with_provenance(output / "README.md", page(data, table, measures, command), sources, command)
    return sorted(output.iterdir())
