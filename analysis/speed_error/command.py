"""`./lab speed-error`: runs a study, or goes on with it, and writes its data, figures and page."""

from __future__ import annotations

import argparse
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

import pandas

from analysis.netcdf import characters
from analysis.places import results_folder
from analysis.speed_error import figures
from analysis.speed_error.design import DESIGNS, Design
from analysis.speed_error.errors import errors
from analysis.speed_error.jobs import run_study
from analysis.speed_error.measures import measure_others
from analysis.speed_error.page import page
from analysis.speed_error.table import collect, open_study, restore
from labkit.cli.arguments import positive_int
from labkit.dem import Progress
from labkit.engines import find_yade
from labkit.io import make_folder, reporter, whole_file, write_provenance, write_with_provenance
from labkit.visuals import plots


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of `./lab speed-error`."""
    parser.add_argument(
        "--design",
        choices=("full", "small"),
        default="full",
        help="full: hours; small: the same in a minute (default: full)",
    )
    parser.add_argument(
        "--work",
        help="folder of specimens and runs, from which an interrupted study goes on "
        "(default: speed_error_full or speed_error_small)",
    )
    parser.add_argument("--from", dest="earlier", help="study.nc of a study whose tests need not be repeated")
    parser.add_argument("--jobs", type=positive_int, help="runs at a time (default: as many as cores)")
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("speed_error"),
        help="folder of the results (default: results/speed_error)",
    )


def main(options: argparse.Namespace, command: str) -> None:
    """Runs the study and names its files."""
    find_yade()
    work = options.work or f"speed_error_{options.design}"
    jobs = options.jobs or os.cpu_count() or 1
    for file in speed_error(options.design, work, options.output, jobs, reporter("speed-error"), options.earlier):
        print(file)


def speed_error(
    design_name: str,
    work: str | Path,
    output: str | Path,
    jobs: int,
    progress: Progress,
    earlier: str | Path | None = None,
) -> list[Path]:
    """Runs the design in the folder `work`, writes the folder `output`; returns the files. `earlier`: the study.nc of a
    study whose tests need not be repeated.
    """
    design = DESIGNS[design_name]()
    if earlier:
        with open_study(earlier) as data:
            restore(data, design, work)
    make_folder(output, "--output")
    run_study(design, work, jobs, progress)
    measures = measure_others(design, work, progress)
    return write(design, work, Path(output), measures, f"./lab speed-error --design {design_name}")


def write(
    design: Design, work: str | Path, output: Path, measures: Mapping[str, pandas.DataFrame], command: str
) -> list[Path]:
    """Writes the data set, the tables, the figures and the page of a finished study; their files."""
    data = collect(design, work)
    table = errors(data, measures["settings"])
    with whole_file(output / "study.nc") as temporary:
        data.to_netcdf(temporary, encoding=characters(data))
    write_provenance(output / "study.nc", command=command)
    text = table.to_csv(index=False, float_format="%.5g")
    write_with_provenance(output / "errors.csv", text, [output / "study.nc"], command)
    for file in sorted((Path(work) / "measures").iterdir()):
        if file.name != "model.csv":  # the lines of model_speed.txt
            shutil.copyfile(file, output / file.name)
            if file.suffix != ".png":
                write_provenance(output / file.name, command=command)
    drawn = {
        "pareto_cp.png": figures.pareto(table),
        "pareto_cv.png": figures.pareto(table, "cv"),
        "changes.png": figures.changes(table),
        "sizes.png": figures.sizes(table),
    }
    for name, figure in drawn.items():
        plots.save(figure, output / name)
    made_of = [output / "study.nc", output / "errors.csv"]
    write_with_provenance(output / "README.md", page(data, table, measures, command), made_of, command)
    return sorted(output.iterdir())
