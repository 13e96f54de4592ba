"""`./lab speed-error`: runs or resumes a study, or takes the stored one, and writes results/speed_error."""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

import pandas
import xarray as xr

from analysis.netcdf import write_data
from analysis.pictures import reduce_colours
from analysis.speed_error import figures
from analysis.speed_error.design import DESIGNS, read_design
from analysis.speed_error.errors import errors
from analysis.speed_error.jobs import run_study
from analysis.speed_error.measures import measure_others
from analysis.speed_error.numbers import page_numbers
from analysis.speed_error.table import collect, open_study, restore
from analysis.study import STEPS, Figures, StoredTables, Study, Tables, Values
from labkit.cli.arguments import positive_int
from labkit.engines import find_yade
from labkit.files import write_provenance
from labkit.process import reporter, resumed_from


class SpeedError(Study):
    """The speed and the error of all settings."""

    data = "study.nc"
    steps, style = STEPS[2:], figures.STYLE

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        design = "full takes hours, small a minute with shorter tests of fewer grains (default: full)"
        parser.add_argument("--design", choices=tuple(DESIGNS), default="full", help=design)
        work = "folder of specimens and runs, from which an interrupted study resumes "
        parser.add_argument("--work", help=work + "(default: speed_error_full or speed_error_small)")
        earlier = "study.nc of an earlier study; tests it already contains are not run again"
        parser.add_argument("--from", dest="earlier", help=earlier)
        jobs = "number of simultaneous runs (default: number of cores)"
        parser.add_argument("--jobs", type=positive_int, default=os.cpu_count() or 1, help=jobs)
        super().add_options(parser)

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        find_yade()
        work = Path(options.work or f"speed_error_{options.design}")
        with resumed_from(work):
            self.run(options, work, folder, command)
        return 0

    def run(self, options: argparse.Namespace, work: Path, folder: Path, command: str) -> None:
        """Runs what the folder `work` lacks and writes the data set and the other measurements."""
        design, progress = read_design(options.design), reporter("speed-error")
        if options.earlier:
            with open_study(options.earlier) as data:
                restore(data, design, work)
        run_study(design, work, options.jobs, progress)
        measure_others(design, work, progress)
        write_data(folder / self.data, collect(design, work), command)
        for file in sorted((work / "measures").iterdir()):
            shutil.copyfile(file, folder / file.name)
            if file.suffix == ".png":
                reduce_colours(folder / file.name)
            else:
                write_provenance(folder / file.name, command=command)

    def read(self, file: Path) -> tuple[xr.Dataset, pandas.DataFrame]:
        return open_study(file), StoredTables(file.parent)["settings"]

    def tables(self, data: tuple[xr.Dataset, pandas.DataFrame]) -> Tables:
        return {"errors": errors(*data)}

    def figures(self, data: object, tables: StoredTables) -> Figures:
        table = tables["errors"]
        return {
            "pareto_cp": figures.pareto(table),
            "pareto_cv": figures.pareto(table, "cv"),
            "changes": figures.changes(table),
            "sizes": figures.sizes(table),
        }

    def numbers(self, tables: StoredTables) -> Values:
        with open_study(tables.folder / self.data) as data:
            return {"worst": figures.WORST} | page_numbers(data, tables)


STUDY = SpeedError()
