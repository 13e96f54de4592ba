"""`./lab other-paths`: runs the campaigns, or uses the stored data set, and writes results/other_paths."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

from analysis.campaigns import finished, save_figures, simulate, write_tables
from analysis.other_paths.collect import reduced
from analysis.other_paths.engines import agreement, cycles_table, liquefaction_figure, read_curves
from analysis.other_paths.errors import COMPONENTS, REFERENCE, budget_table, comparison, error_table, form_table
from analysis.other_paths.figures import TESTS, error_figure, rotation_figure, strength_figure
from analysis.other_paths.strength import end_table, mean_table, model_strength, strength_ratio
from analysis.study import Figures, StoredTables, Study, Tables, Values
from labkit.io import reporter
from labkit.model import Model


class OtherPaths(Study):
    """Loading paths beyond the paper's: the errors of C0 and the strength."""

    data, title = "statistics.nc", "Loading paths beyond the paper's"
    tests = "paths.yaml"

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        super().add_options(parser)
        engines = "folder of the campaign that compares the engines (default: none)"
        parser.add_argument("engines", nargs="?", help=engines)

    def only_redraws(self, options: argparse.Namespace) -> bool:
        return not (options.campaign or options.engines)

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        """Also runs the campaign that compares the engines, and writes its tables and figure; --redraw keeps them."""
        code = super().prepare(options, folder, command) if options.campaign else 0
        if options.engines:
            if not options.as_is:
                progress, tests = reporter("engines"), self.home / "engines.yaml"
                code = code or simulate(options.engines, options.cores, progress, tests)
            files = finished(options.engines)
            curves = read_curves(files, reporter("comparison"))
            tables = {"engines": agreement(curves), "liquefaction": cycles_table(files)}
            write_tables(tables, folder, files, command, self.rounding)
            save_figures({"liquefaction": liquefaction_figure(files)}, folder, files, command)
        return int(code != 0)

    reduce = staticmethod(reduced)

    def tables(self, data: xr.Dataset) -> Tables:
        errors, ends = error_table(data), end_table(data)
        tables = {
            "c0_errors": errors,
            "c0_forms": form_table(data),
            "c0_budget": budget_table(data),
            "c0_comparison": comparison(errors),
            "ends": ends,
            "strength": mean_table(ends),
        }
        start = data.sel(run=data["run"].values[data["test"].values == REFERENCE][0]).isel(point=0)
        b = np.linspace(0.0, 1.0, 11)
        model = Model().reading(beyond_e_cmax="flat")
        strength = model_strength(model, float(start["void_ratio_nominal"]), float(start["coordination_number"]), b)
        return tables | {"model_strength": pandas.DataFrame({"b": b, "M": strength})}

    def figures(self, data: xr.Dataset, tables: StoredTables) -> Figures:
        return {
            "strength": strength_figure(tables["ends"], tables["strength"], tables["model_strength"]),
            "c0_errors": error_figure(tables["c0_errors"]),
            "c0_components": rotation_figure(data),
        }

    def numbers(self, tables: StoredTables) -> Values:
        errors = tables["c0_errors"].groupby("test")
        means = 100.0 * errors[["p", "q", "ratio", "norm", *COMPONENTS]].mean()
        means = means.assign(worst=100.0 * errors["worst"].max(), angle=errors["angle"].mean(), specimens=errors.size())
        compared = tables["c0_comparison"].assign(name=tables["c0_comparison"]["test"].map(TESTS))
        compared[["difference", "within", "limit"]] *= 100.0
        strength = tables["strength"].set_index("test")
        budget, forms = (
            100.0 * tables[name].pivot(index="test", columns=column, values="q")
            for name, column in (("c0_budget", "part"), ("c0_forms", "form"))
        )
        return {
            "errors": in_order(means),
            "comparison": compared,
            "budget": in_order(budget),
            "forms": in_order(forms),
            "strength": in_order(strength),
            "ratio": strength_ratio(tables["ends"]),
            "nakai": 3.0 / (3.0 + strength.loc[REFERENCE, "M"]),  # (3 - s)/(3 + s), s = sin phi = 3 M_c/(6 + M_c)
            "engines": beside_the_scatter(tables["engines"]) if "engines" in tables else None,
        }


STUDY = OtherPaths()


def in_order(frame: pandas.DataFrame) -> pandas.DataFrame:
    """A table whose index is the test, in the order of TESTS, with the column `name` of their labels."""
    return frame.loc[[test for test in TESTS if test in frame.index]].assign(name=lambda rows: rows.index.map(TESTS))


def beside_the_scatter(compared: pandas.DataFrame) -> pandas.DataFrame:
    """A row per test with engines_QUANTITY and between_specimens_QUANTITY."""
    wide = compared.pivot(index="test", columns="quantity", values=["engines", "between_specimens"])
    return wide.set_axis(wide.columns.map("_".join), axis=1).loc[compared["test"].unique()].reset_index()
