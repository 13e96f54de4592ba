"""`./lab volume FOLDER`: makes the specimens and their tests, or uses the stored snapshots; writes results/volume."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis import campaigns
from analysis.pages import render
from analysis.places import results_folder
from analysis.study import STEPS, Figures, StoredTables, Study, Tables, Values
from analysis.volume.forms import FORMS, snapshots
from analysis.volume.questions import (
    CELL,
    MARGIN,
    PLANNED,
    by_test,
    checks,
    closures,
    engines,
    errors,
    extremes,
    failing,
    goal,
    large_strain,
    missing,
    neglected,
    power,
    stored,
    variables,
)
from analysis.volume.simulate import (
    CLUMPS,
    OF_CLUMPS,
    SPHERES,
    TESTS,
    finished,
    finished_again,
    finished_on_both,
    simulate,
)
from labkit.engines import Progress
from labkit.figures import WIDTH, new_figure
from labkit.files import write_with_provenance
from labkit.sff import NEGLECTED

COLORS = {"volume": "C0", "number": "C3"}
SHOWN = {"c0": ("C0 as printed", ":"), "c0_volume": ("by volume", "-"), "c0_volume + 2": ("with two terms", "--")}
LABELS = ("test", "shape", "grading", "seed")  # in the names of the run files
ORDER = {name: number for number, name in enumerate(["spheres", *CLUMPS, *SPHERES])}


class Volume(Study):
    """The equation by volume for wide gradings and other shapes."""

    data = "snapshots.csv.gz"

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Adds the folder of the runs and --as-is to those of every study."""
        parser.add_argument("folder", nargs="?", help="folder for the runs (default: use the stored snapshots)")
        parser.add_argument("--as-is", action="store_true", help="run nothing: use the rounds that are complete")
        self.add_output(parser)

    def only_redraws(self, options: argparse.Namespace) -> bool:
        return not options.folder

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        """Runs what is missing, and gathers what is complete."""
        runs = Path(options.folder)
        runs.mkdir(parents=True, exist_ok=True)
        if "campaign" in options.steps and not options.as_is:
            simulate(runs)
        if "gather" in options.steps:
            sets = {
                "rounds": (finished(runs), LABELS),
                "engines": (finished_on_both(runs), (*LABELS, "engine")),
                "failing": (finished_again(runs), ("test", "shape", "seed")),
            }
            tables = [reduced(run, labels).assign(set=name) for name, (files, labels) in sets.items() for run in files]
            campaigns.write_compressed(pandas.concat(tables), folder / self.data, [], command, "%.4g")
        return 0

    def tables(self, data: pandas.DataFrame) -> Tables:
        data = data.reindex(columns=list(dict.fromkeys([*data, "engine"])))  # if no engine but fused has run
        rounds, of_both, repeated = (data[data["set"] == name] for name in ("rounds", "engines", "failing"))
        found, means = errors(rounds), by_test(rounds)
        terms = neglected(rounds)
        wild = failing(pandas.concat([rounds, repeated]))
        return {
            "errors": found,
            "by_test": means,
            "neglected": terms,
            "goal": goal(found, terms),
            "variables": variables(rounds),
            "extremes": extremes(rounds),
            "failing": wild,
            "closures": closures(found, means, wild),
            "engines": engines(of_both),
            "checks": checks(data),
            "missing": missing(rounds),
            "power": power(found, means),
            "stored": stored(),
            "large_strain": large_strain(),
        }

    def figures(self, data: pandas.DataFrame, tables: Mapping[str, pandas.DataFrame]) -> Figures:
        return {
            "errors": draw_errors(tables["errors"], tables["by_test"]),
            "neglected": draw_neglected(tables["neglected"]),
        }

    def numbers(self, tables: Mapping[str, pandas.DataFrame]) -> Values:
        found, means, of_checks = tables["errors"], tables["by_test"], tables["checks"]
        planned = found[found["group"].isin(PLANNED)]
        counts = planned.groupby(["form", "outcome"], sort=False).size().unstack(fill_value=0)
        counts = counts.reindex(columns=["below", "not resolved", "above"], fill_value=0).reindex(list(FORMS))
        worst = planned.loc[planned.groupby("form", sort=False)["q"].apply(lambda q: q.abs().idxmax())]
        counts = counts.join(worst.set_index("form")[[*CELL, "q", "q_within"]]).reset_index()
        kinds = found["group"].where(found["group"].isin(PLANNED), "other ratios")
        return {
            "wide_q": wide(found, "q"),
            "wide_p": wide(found, "p"),
            "counts": counts.rename(columns={"not resolved": "unresolved"}),
            "cells": len(planned) // len(FORMS),
            "of_test": {form: means[means["form"] == form] for form in FORMS},
            "outcome": {key: len(part) for key, part in planned.groupby(["form", "group", "outcome"])},
            "seeds": planned.groupby("group")["specimens"].max().to_dict(),
            "worst": {key: part["q"].abs().max() for key, part in found.groupby([kinds, "form"])},
            "worst_p": {key: part["p"].abs().max() for key, part in found.groupby([kinds, "form"])},
            "judged": of_checks["judged"].sum(),
            "all_snapshots": of_checks["snapshots"].sum(),
            "exact": of_checks["largest_error_of_p"].max(),
            "stored_snapshots": tables["stored"]["snapshots"].sum(),
            "stored_exact": tables["stored"]["largest_error_of_p"].max(),
            "earlier": failing_fourth(),
            "again": (of_checks["set"] == "failing").any(),
            "others": sorted(set(found["group"]) - set(PLANNED)),
            "largest_terms": tables["neglected"]["largest"].value_counts().to_dict(),
            "margin": MARGIN,
        }

    def write(self, folder: Path, command: str, progress: Progress, steps: Sequence[str] = STEPS) -> list[Path]:
        files = super().write(folder, command, progress, steps)
        if "page" in steps:
            tables = StoredTables(folder)
            values = {"tables": tables, "command": command} | dict(self.numbers(tables))
            note = render(self.home / "note.md", values)
            write_with_provenance(folder / "note.md", note, self.sources(folder), command)
            files.append(folder / "note.md")
        return files


STUDY = Volume()


def reduced(run: Path, labels: Sequence[str]) -> pandas.DataFrame:
    """The snapshots of a run, from the table beside it, which is made once."""
    table = run.with_name(run.name.replace(".run.nc", ".csv"))
    if not table.exists() or table.stat().st_mtime < run.stat().st_mtime:
        table.write_text(snapshots(run, labels).to_csv(index=False, float_format="%.5g"), encoding="utf-8")
    return pandas.read_csv(table)


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


def draw_errors(found: pandas.DataFrame, means: pandas.DataFrame) -> Figure:
    """Error of q against the size ratio: of both equations in spheres, and of that by volume in spheres and clumps.

    The bars are 95 % intervals. Of clumps the means over the shapes, whose size ratio is by volume.
    """
    ratio = found["grading"].str.split(expand=True)
    spheres = found.assign(ratio=ratio[0].astype(float), by=ratio[1])[lambda table: table["shape"] == "spheres"]
    of_clumps = means[means["group"].str.startswith("clumps")]
    of_clumps = of_clumps.assign(ratio=of_clumps["group"].str.split().str[1].fillna(OF_CLUMPS.split()[0]).astype(float))
    figure = new_figure(WIDTH, 6.2)
    grid = figure.subplots(3, len(TESTS), sharex=True, sharey="row")
    for column, test in zip(grid.T, TESTS, strict=True):
        for axes in column:
            axes.axhspan(-100.0 * MARGIN, 100.0 * MARGIN, color="0.9", zorder=0)
        for by, color in COLORS.items():
            part = spheres[(spheres["test"] == test) & (spheres["by"] == by)]
            draw_curves(column[0], part, ("c0", "c0_volume"), color, f", spheres by {by}")
            draw_curves(column[1], part, ("c0_volume", "c0_volume + 2"), color, f", spheres by {by}")
        part = of_clumps[of_clumps["test"] == test].sort_values("ratio")
        draw_curves(column[2], part, ("c0_volume", "c0_volume + 2"), "C2", ", clumps by volume")
        column[0].set_title("b = 0.5" if test == "b" else test, fontsize=10)
        column[2].set(xlabel="size ratio", xscale="log", xticks=[1.2, 2, 4, 8])
        column[2].set_xticks([], minor=True)
        column[2].set_xticklabels(["1.2", "2", "4", "8"])
    for axes in grid[:, 0]:
        axes.set_ylabel("error of q (%)")
    shown = dict(pair[::-1] for axes in grid[:, 0] for pair in zip(*axes.get_legend_handles_labels(), strict=True))
    figure.legend(shown.values(), shown.keys(), fontsize=7, ncols=3, loc="outside lower center")
    return figure


def draw_curves(axes: Axes, part: pandas.DataFrame, forms: Sequence[str], color: str, of: str) -> None:
    """Error of q of some equations against the size ratio, with 95 % intervals."""
    for form in forms:
        curve = part[part["form"] == form]
        name, style = SHOWN[form]
        axes.errorbar(
            curve["ratio"],
            100.0 * curve["q"],
            100.0 * curve["q_within"],
            fmt=f"o{style}",
            ms=2.5,
            lw=0.9,
            color=color,
            label=f"{name}{of}",
        )


def draw_neglected(table: pandas.DataFrame) -> Figure:
    """The terms that the equation by volume neglects in q, each for itself, a bar per cell."""
    figure = new_figure(WIDTH, 6.0)
    for axes, test in zip(figure.subplots(1, len(TESTS), sharey=True), TESTS, strict=True):
        part = table[table["test"] == test]
        part = part.sort_values(["shape", "grading"], key=lambda names: names.map(ORDER), kind="stable")
        rows = [
            grading if shape == "spheres" else f"{shape} {grading.removesuffix(' volume')}"
            for shape, grading in zip(part["shape"], part["grading"], strict=True)
        ]
        at = np.arange(len(part))
        for number, name in enumerate(NEGLECTED):
            offset, size = 0.27 * (number - 1), 100.0 * part[f"neglected {name}"]
            axes.barh(at + offset, size, 0.27, color=f"C{number}", label=NEGLECTED[name])
        axes.plot(-100.0 * part["c0_volume q"], at, "k|", ms=6, label="their sum, Love - equation")
        axes.axvline(0.0, color="0.5", lw=0.7)
        axes.set(yticks=at, xlabel="% of q")
        axes.set_yticklabels(rows, fontsize=7)
        axes.set_title("b = 0.5" if test == "b" else test, fontsize=10)
        axes.invert_yaxis()
    figure.legend(*figure.axes[0].get_legend_handles_labels(), fontsize=8, ncols=4, loc="outside lower center")
    return figure
