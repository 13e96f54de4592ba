"""The framework of a study: runs a campaign, gathers its runs, and makes tables, figures and a page."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import matplotlib.pyplot as plt
import pandas
import xarray as xr
from matplotlib.figure import Figure

from analysis.campaigns import add_campaign_options, finished, save_figures, simulate, write_tables
from analysis.curves import curves_of
from analysis.manifest import collect, provenance
from analysis.netcdf import write_data
from analysis.pages import render
from analysis.places import results_folder
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.files import make_folder, write_with_provenance
from labkit.plugins.campaigns import read_campaign
from labkit.process import reporter
from labkit.results import open_run

Tables = dict[str, pandas.DataFrame]
Figures = Mapping[str, Figure]
Values = Mapping[str, Any]
STEPS = ("campaign", "gather", "tables", "figures", "page")


class StoredTables(dict[str, pandas.DataFrame]):
    """The tables in a folder, by name; a missing one is an InputError."""

    def __init__(self, folder: Path) -> None:
        """Reads every CSV file of the folder."""
        files = sorted([*folder.glob("*.csv"), *folder.glob("*.csv.gz")])
        super().__init__({file.name.partition(".")[0]: pandas.read_csv(file) for file in files})
        self.folder = folder

    def __missing__(self, name: str) -> pandas.DataFrame:
        raise InputError(f"{self.folder} contains no {name}.csv: add `tables` to --steps")


class Study:
    """A study in a folder of analysis/, with `campaign.yaml` and the template `page.md`.

    A subclass defines which data it keeps from a run, what it computes and draws, and the numbers on its page.
    """

    data: str  # the data set in the folder of the results, from which everything else follows
    title = ""  # title of the data set
    tests = "campaign.yaml"
    steps: Sequence[str] = STEPS  # steps of the command
    rounding = "%.5g"  # format of the numbers in the tables
    style: ClassVar[dict[Any, Any]] = {}  # rcParams of matplotlib for the figures
    progress: Progress  # of the tables, for those that take long

    @staticmethod
    def reduce(run: xr.Dataset) -> xr.Dataset:
        """Return the data of a run that the data set contains."""
        return curves_of(run)

    def stored(self) -> tuple[Mapping[str, xr.Dataset], Sequence[Path]]:
        """Reduced runs of other studies that also belong to the data set, by name, and their files."""
        return {}, ()

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        """Reduces finished runs to the data set `file`: a netCDF file with the dimension run, in single precision.

        Coordinates along run: run, test and specimen, e.g. `extension-s3`, `extension` and `s3`.
        """
        sets, progress = dict[str, xr.Dataset](), reporter("reading")
        for k, one in enumerate(runs):
            name = one.name.removesuffix(".run.nc")
            progress(k / len(runs), name)
            with open_run(one) as run:
                sets[name] = self.reduce(run)
        others, of_others = self.stored()
        sets |= others
        tests, _, specimens = zip(*(name.partition("-") for name in sets), strict=True)
        labels = {"run": list(sets), "test": ("run", list(tests)), "specimen": ("run", list(specimens))}
        data = xr.concat(sets.values(), "run", join="outer").assign_coords(labels)
        data.attrs = {"title": self.title}
        write_data(file, data, command, [*runs, *of_others], single=True)

    def read(self, file: Path) -> Any:
        """The data set."""
        return xr.load_dataset(file) if file.suffix == ".nc" else pandas.read_csv(file)

    def tables(self, data: Any) -> Tables:
        """All tables by name, computed from the data set; each is stored as NAME.csv."""
        return {}

    def figures(self, data: Any, tables: StoredTables) -> Figures:
        """All figures by name, from the data set and the stored tables; each is stored as NAME.png."""
        return {}

    def numbers(self, tables: StoredTables) -> Values:
        """Values for the page, in addition to `tables`, `command`, `made_by`, `planned` and `code`.

        `made_by` is the command that wrote the data set, `planned` the number of tests in the campaign, and `code` the
        module of the study with its constants.
        """
        return {}

    @property
    def home(self) -> Path:
        """Folder of the study's code; that of its results has the same name."""
        return Path(inspect.getfile(type(self))).parent

    @property
    def campaign(self) -> Path:
        """The campaign file."""
        return self.home / self.tests

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Adds the options of the command: those of its campaign, or --redraw without one; -o and --steps."""
        if self.campaign.exists():
            add_campaign_options(
                parser, f"the tables and figures are written again from {self.data} in the output folder"
            )
        else:
            redraw = f"run nothing: write the figures and the page again from {self.data} in the output folder"
            parser.add_argument("--redraw", action="store_true", help=redraw)
        self.add_output(parser)

    def add_output(self, parser: argparse.ArgumentParser) -> None:
        """Adds -o and, for a study with several steps, --steps."""
        name = self.home.name
        output = f"folder for the results (default: results/{name})"
        parser.add_argument("-o", "--output", default=results_folder(name), help=output)
        parser.set_defaults(steps=self.steps)
        if len(self.steps) > 1:
            parser.add_argument("--steps", choices=self.steps, nargs="+", help="what to do (default: everything)")

    def only_redraws(self, options: argparse.Namespace) -> bool:
        """True if the command takes the data set that is stored in the output folder."""
        return options.redraw if "redraw" in options else not options.campaign

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        """Runs the campaign and gathers its runs in the data set; returns 1 if a run failed."""
        code = 0
        if "campaign" in options.steps and not options.as_is:
            code = simulate(options.campaign, options.cores, reporter("campaign"), self.campaign)
        if "gather" in options.steps:
            self.gather(finished(options.campaign), folder / self.data, command)
        return int(code != 0)

    def sources(self, folder: Path) -> Sequence[str | Path]:
        """Files from which the results are made, for their provenance."""
        return [folder / self.data]

    def main(self, options: argparse.Namespace, command: str) -> int:
        """Carries out the steps and prints the files written; returns 1 if a run failed."""
        folder, code = Path(options.output), 0
        if not self.only_redraws(options):
            code = self.prepare(options, Path(make_folder(folder, "--output")), command)
        elif not (folder / self.data).exists():
            raise InputError(f"{folder} contains no {self.data}: give the output folder (-o) of a study that has ended")
        for file in self.write(folder, command, reporter("tables"), options.steps):
            print(file)
        collect(folder)
        return code

    def write(self, folder: Path, command: str, progress: Progress, steps: Sequence[str] = STEPS) -> list[Path]:
        """Writes tables, figures and page from the data set in a folder; returns the files.

        Figures and page are made from the stored tables, so that they can be written again by themselves.
        """
        source, files = self.sources(folder), list[Path]()
        data = self.read(folder / self.data) if {"tables", "figures"} & set(steps) else None
        if "tables" in steps:
            self.progress = lambda done, text: progress(0.7 * done, text)
            files += write_tables(self.tables(data), folder, source, command, self.rounding)
        progress(0.7, "figures")
        tables = StoredTables(folder)
        if "figures" in steps:
            with plt.rc_context(self.style):
                drawn = self.figures(data, tables)
            files += save_figures(drawn, folder, source, command)
        if "page" in steps:
            planned = len(read_campaign(self.campaign).runs) if self.campaign.exists() else 0
            own = f"./lab {self.home.name}".replace("_", "-")
            made_by = (provenance(folder / self.data) or {}).get("command", own)
            values = {"tables": tables, "command": command, "made_by": made_by, "planned": planned}
            values["code"] = inspect.getmodule(type(self))
            page = render(self.home / "page.md", values | dict(self.numbers(tables)))
            write_with_provenance(folder / "README.md", page, source, command)
            files.append(folder / "README.md")
        progress(1.0, "done")
        return files
