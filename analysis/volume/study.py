"""`./lab volume FOLDER`: makes the specimens and their tests, or uses the stored snapshots; writes results/volume."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
from matplotlib.figure import Figure

from analysis.pages import render
from analysis.places import results_folder
from analysis.study import STEPS, Figures, Study, Tables, Values
from analysis.volume.forms import FORMS, snapshots
from analysis.volume.questions import (
    MARGIN,
    by_test,
    checks,
    errors,
    extremes,
    judged,
    large_strain,
    neglected,
    pooled,
    power,
    stored,
    variables,
)
from analysis.volume.simulate import TESTS, finished, simulate
from labkit.engines import Progress
from labkit.figures import WIDTH, new_figure
from labkit.files import write_with_provenance
from labkit.sff import NEGLECTED

COLORS = {"volume": "C0", "number": "C3"}
SHOWN = {"c0": ":", "c0_volume": "-"}


class Volume(Study):
    """The equation by volume for wide gradings and other shapes."""

    data = "snapshots.csv"

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Adds the folder of the runs and --as-is to those of every study."""
        parser.add_argument("folder", nargs="?", help="folder for the runs (default: use the stored snapshots)")
        parser.add_argument("--as-is", action="store_true", help="run nothing: use the rounds that are complete")
        self.add_output(parser)

    def only_redraws(self, options: argparse.Namespace) -> bool:
        return not options.folder

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        """Runs what is missing, and gathers the rounds that are complete."""
        runs = Path(options.folder)
        runs.mkdir(parents=True, exist_ok=True)
        if "campaign" in options.steps and not options.as_is:
            simulate(runs)
        if "gather" in options.steps:
            self.gather(finished(runs), folder / self.data, command)
        return 0

    def gather(self, runs: Sequence[Path], file: Path, command: str) -> None:
        """Reduces each run to a small table beside its file, once, and joins the tables."""
        tables = []
        for run in runs:
            table = run.with_name(run.name.replace(".run.nc", ".csv"))
            if not table.exists() or table.stat().st_mtime < run.stat().st_mtime:
                table.write_text(snapshots(run).to_csv(index=False, float_format="%.5g"), encoding="utf-8")
            tables.append(pandas.read_csv(table))
        text = pandas.concat(tables).to_csv(index=False, float_format="%.5g")
        write_with_provenance(file, text, [], command)

    def read(self, file: Path) -> pandas.DataFrame:
        return pandas.read_csv(file)

    def tables(self, data: pandas.DataFrame) -> Tables:
        found = errors(data)
        return {
            "errors": found,
            "by_test": by_test(data),
            "neglected": neglected(data),
            "variables": variables(data),
            "extremes": extremes(data),
            "checks": checks(data),
            "pooled": pooled(found),
            "power": power(found),
            "stored": stored(),
            "large_strain": large_strain(),
        }

    def figures(self, data: pandas.DataFrame, tables: Mapping[str, pandas.DataFrame]) -> Figures:
        return {
            "errors": draw_errors(tables["errors"], tables["pooled"]),
            "neglected": draw_neglected(tables["neglected"]),
        }

    def numbers(self, tables: Mapping[str, pandas.DataFrame]) -> Values:
        found, late = tables["errors"], judged(tables["snapshots"])
        counts = found.groupby(["form", "outcome"], sort=False).size().unstack(fill_value=0)
        counts = counts.reindex(columns=["below", "not resolved", "above"], fill_value=0).reindex(list(FORMS))
        worst = found.loc[found.groupby("form", sort=False)["q"].apply(lambda q: q.abs().idxmax())].set_index("form")
        counts = counts.join(worst[[*("shape", "grading", "test"), "q", "q_within"]]).reset_index()
        spheres = found[found["shape"] == "spheres"]
        worst_of = {
            (group, form): part["q"].abs().max()
            for (group, form), part in found.groupby(
                [np.where(found["shape"] == "spheres", "spheres", "clumps"), "form"]
            )
        }
        return {
            "wide_q": wide(found, "q"),
            "wide_p": wide(found, "p"),
            "counts": counts.rename(columns={"not resolved": "unresolved"}),
            "cells": len(found) // len(FORMS),
            "of_test": {form: tables["by_test"][tables["by_test"]["form"] == form] for form in FORMS},
            "seeds": spheres["specimens"].max() if len(spheres) else 0,
            "clump_seeds": found.loc[found["shape"] != "spheres", "specimens"].max(),
            "judged": len(late),
            "worst": worst_of,
            "all_snapshots": len(tables["snapshots"]),
            "exact": tables["snapshots"]["c0_volume p"].abs().max(),
            "stored_snapshots": tables["stored"]["snapshots"].sum(),
            "stored_exact": tables["stored"]["largest_error_of_p"].max(),
            "ratio": functools.partial(ratio_of, spheres),
            "failing": failing_fourth(),
            "largest_terms": tables["neglected"]["largest"].value_counts().to_dict(),
            "margin": MARGIN,
        }

    def write(self, folder: Path, command: str, progress: Progress, steps: Sequence[str] = STEPS) -> list[Path]:
        files = super().write(folder, command, progress, steps)
        if "page" in steps:
            tables = {file.stem: pandas.read_csv(file) for file in sorted(folder.glob("*.csv"))}
            values = {"tables": tables, "command": command} | dict(self.numbers(tables))
            note = render(self.home / "note.md", values)
            write_with_provenance(folder / "note.md", note, self.sources(folder), command)
            files.append(folder / "note.md")
        return files


STUDY = Volume()


def ratio_of(spheres: pandas.DataFrame, form: str, grading: str, test: str, component: str = "q") -> float:
    """Mean error of a form in a cell of spheres, a fraction."""
    cell = spheres.query("form == @form and grading == @grading and test == @test")
    return float(cell[component].iloc[0])


def failing_fourth() -> dict[str, float]:
    """Snapshots of results/clumps in which `fourth` errs by more than 10 % of q: number, of, least, largest."""
    data = pandas.read_csv(results_folder("clumps") + "/snapshots.csv.gz")
    error = data[(data["engine"] == "fused") & (data["strain"] >= 0.02)]["fourth q"].abs()
    wild = error[error > 0.1]
    return {"number": len(wild), "of": len(error), "least": wild.min(), "largest": wild.max()}


def wide(found: pandas.DataFrame, component: str) -> pandas.DataFrame:
    """Errors (%) of a component, a row per cell and a column per form, with `_within`."""
    index = ["shape", "grading", "test", "specimens"]
    part = found.assign(**{name: 100.0 * found[name] for name in (component, f"{component}_within")})
    part = part.set_index([*index, "form"])[[component, f"{component}_within"]]
    values, within = (part[name].unstack("form") for name in part)
    order = found.drop_duplicates(index).set_index(index).index
    return values.join(within.add_suffix("_within")).reindex(order).reset_index()


def draw_errors(found: pandas.DataFrame, pooled: pandas.DataFrame) -> Figure:
    """Error of q of spheres against the size ratio: both equations, and below the equation by volume alone.

    The bars are 95 % intervals with the scatter of all cells (`pooled`).
    """
    half = pooled.set_index("form")["half"]
    spheres = found[found["shape"] == "spheres"].copy()
    names = spheres["grading"].str.split(expand=True)
    spheres = spheres.assign(ratio=names[0].astype(float), by=names[1])
    figure = new_figure(WIDTH, 4.6)
    grid = figure.subplots(2, len(TESTS), sharex=True, sharey="row")
    for column, test in zip(grid.T, TESTS, strict=True):
        for axes, forms in zip(column, (tuple(SHOWN), ("c0_volume",)), strict=True):
            axes.axhspan(-100.0 * MARGIN, 100.0 * MARGIN, color="0.9", zorder=0)
            for by, color in COLORS.items():
                for form in forms:
                    part = spheres[(spheres["test"] == test) & (spheres["by"] == by) & (spheres["form"] == form)]
                    label = f"{'C0 as printed' if form == 'c0' else 'by volume'}, grading uniform by {by}"
                    q, within = 100.0 * part["q"], 100.0 * half[form]
                    axes.errorbar(
                        part["ratio"], q, within, fmt=f"o{SHOWN[form]}", ms=3, lw=1.0, color=color, label=label
                    )
        column[0].set_title("b = 0.5" if test == "b" else test, fontsize=10)
        column[1].set(xlabel="size ratio", xscale="log", xticks=[1.2, 2, 4, 8], ylim=(-4.0, 4.0))
        column[1].set_xticks([], minor=True)
        column[1].set_xticklabels(["1.2", "2", "4", "8"])
    for axes in grid[:, 0]:
        axes.set_ylabel("error of q (%)")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), fontsize=8, ncols=2, loc="outside lower center")
    return figure


def draw_neglected(table: pandas.DataFrame) -> Figure:
    """The terms that the equation by volume neglects in q, each for itself, a bar per cell."""
    figure = new_figure(WIDTH, 2.8)
    for axes, test in zip(figure.subplots(1, len(TESTS), sharey=True), TESTS, strict=True):
        part = table[table["test"] == test]
        rows = [
            f"{grading}" if shape == "spheres" else shape
            for shape, grading in zip(part["shape"], part["grading"], strict=True)
        ]
        at = np.arange(len(part))
        for number, name in enumerate(NEGLECTED):
            axes.barh(
                at + 0.27 * (number - 1),
                100.0 * part[f"neglected {name}"],
                0.27,
                color=f"C{number}",
                label=NEGLECTED[name],
            )
        axes.plot(-100.0 * part["c0_volume q"], at, "k|", ms=9, label="their sum, Love - equation")
        axes.axvline(0.0, color="0.5", lw=0.7)
        axes.set(yticks=at, yticklabels=rows, xlabel="% of q")
        axes.set_title("b = 0.5" if test == "b" else test, fontsize=10)
        axes.invert_yaxis()
    figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=8, ncols=4, loc="outside lower center")
    return figure
