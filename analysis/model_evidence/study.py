"""`./lab model-evidence`: how well the model predicts tests, from the reduced run files of results/paper."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, PercentFormatter

from analysis.critical_state.study import STUDY as CRITICAL_STATE
from analysis.model_evidence.calibrations import AMENDED, CALIBRATED, PATHS, TABLE_2, calibrate_all
from analysis.model_evidence.errors import combined, error_summary, test_errors
from analysis.model_evidence.increments import LENGTH, LENGTHS, increments
from analysis.model_evidence.inversion import inversion_errors
from analysis.model_evidence.new_tests import STRAIN, new_combined, new_errors, new_parts, new_tests
from analysis.model_evidence.residuals import forms_of_c4, missing_elements
from analysis.paper import runs, sources
from analysis.paper.drawing import STYLE, WIDTH
from analysis.paper.ends import ends, in_memory, sheared
from analysis.paper.ends import main as of_the_paper
from analysis.paper.lines import both_lines
from analysis.places import results_folder, texts
from analysis.study import STEPS, Figures, StoredTables, Study, Tables, Values

LABELS: dict[str, str] = texts(__file__)["errors"]
MODELS: Mapping[str, str] = {TABLE_2: "0.6", CALIBRATED: "#0072b2", AMENDED: "#d55e00"}
NAMES: dict[str, str] = texts(__file__)["paths"]
SHORT = {"q_error": "q", "p_error": "p", "e_error_of_change": "e"}


class ModelEvidence(Study):
    """Errors of the model on paths it was not calibrated on, and terms that C1 to C5 lack."""

    data = "calibrations.json"  # the fits, which are repeated if they are missing
    steps, style = STEPS[2:], STYLE
    paper = Path(results_folder("paper"))
    new = Path(results_folder("critical_state")) / CRITICAL_STATE.data

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        paper = "results of ./lab paper (default: results/paper)"
        parser.add_argument("--paper", default=str(self.paper), help=paper)
        new = "data set of ./lab critical-state, whose tests no model was fitted to (default: the stored one)"
        parser.add_argument("--new", default=str(self.new), help=new)
        again = "repeat the calibrations, about 20 minutes on one core, instead of reading them"
        parser.add_argument("--refit", action="store_true", help=again)
        self.add_output(parser)

    def only_redraws(self, options: argparse.Namespace) -> bool:
        return False  # missing calibrations are made with the tables

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        self.paper, self.new = Path(options.paper), Path(options.new)
        if options.refit:
            (folder / self.data).unlink(missing_ok=True)
        return 0

    def sources(self, folder: Path) -> list[str]:
        return [*sources(runs(self.paper)), *([str(self.new)] if self.new.exists() else [])]

    def read(self, file: Path) -> tuple[Mapping[str, xr.Dataset], Path]:
        return of_the_paper(in_memory(runs(self.paper))), file

    def tables(self, data: tuple[Mapping[str, xr.Dataset], Path]) -> Tables:
        known, fits = data
        calibrations = calibrate_all(known, fits, lambda share, text: self.progress(0.8 * share, text))
        self.progress(0.8, "comparing the models with the tests")
        errors = test_errors(known, calibrations)
        self.progress(0.9, "fitting the increments")
        changes, fitted = increments(known), both_lines(ends(sheared(known)))
        forms = [forms_of_c4(increments(known, length), fitted).assign(length=length) for length in LENGTHS]
        monotonic = {name: run for name, run in known.items() if run.attrs["path"] != "cyclic_cp"}
        tables = {
            "errors": errors,
            "summary": error_summary(errors),
            "combined": combined(errors),
            "missing_elements": missing_elements(changes, fitted),
            "forms_of_c4": pandas.concat(forms),
            "inversion": inversion_errors(monotonic),
        }
        if self.new.exists():
            self.progress(0.95, "comparing the models with new tests")
            found = new_errors(new_tests(xr.load_dataset(self.new)), calibrations)
            tables |= {"new_errors": found, "new_summary": error_summary(found), "new_combined": new_combined(found)}
            tables["new_parts"] = new_parts(found)
        return tables

    def figures(self, data: object, tables: StoredTables) -> Figures:
        return {"errors": error_figure(tables["errors"])}

    def numbers(self, tables: StoredTables) -> Values:
        missing = with_gain(tables["missing_elements"])
        of_F = missing[(missing["equation"] == "C1") & missing["candidate"].str.startswith("F")]
        return {
            "summary": wide(tables["summary"]),
            "new_summary": wide(tables["new_summary"]) if "new_summary" in tables else None,
            "strain": STRAIN,
            "missing": missing,
            "better": list(of_F["candidate"][of_F["verdict"] == "better"]),
            "largest": of_F.loc[of_F["high"].idxmax()],
            "length": LENGTH,
            "forms": with_gain(tables["forms_of_c4"]),
        }


STUDY = ModelEvidence()


def wide(summary: pandas.DataFrame) -> pandas.DataFrame:
    """Errors in % as text, a row per path and quantity, a column per model; specimens: the most of any model."""
    names, rows = {NAMES.get(path, path): path for path in dict.fromkeys(summary["path"])}, []
    for name, path in names.items():
        for quantity, own in summary[summary["path"] == path].groupby("quantity", sort=False):
            cells = {row.model: percent(row.value, row.within) for row in own.itertuples()}
            rows.append({"path": name, "error of": SHORT[str(quantity)], "specimens": own["specimens"].max(), **cells})
    return pandas.DataFrame(rows).fillna("")


def with_gain(table: pandas.DataFrame) -> pandas.DataFrame:
    """The table with the gain and its interval in % as text; empty for a form compared with itself."""
    gains = [f"{percent(row.gain)} ({percent(row.low)} to {percent(row.high)})" for row in table.itertuples()]
    return table.assign(gain_text=np.where(np.isfinite(table["gain"]), gains, ""))


def percent(value: float, within: float = np.nan) -> str:
    """A fraction in %, with its interval if there is one; "" for NaN."""
    if not np.isfinite(value):
        return ""
    return f"{100 * value:.1f}" + (f" ± {100 * within:.1f}" if np.isfinite(within) else "")


def error_figure(errors: pandas.DataFrame) -> Figure:
    """Errors of Table 2, of the calibrated and of the amended model; a point per specimen, a bar for their mean."""
    figure, panels = plt.subplots(1, len(LABELS), figsize=(WIDTH, 3.0), layout="constrained")
    for axes, (quantity, label) in zip(panels, LABELS.items(), strict=True):
        known = errors[np.isfinite(errors[quantity])]
        paths = [path for path in PATHS if (known["path"] == path).any()]
        for k, (model, color) in enumerate(MODELS.items()):
            own = known[known["model"] == model]
            each = own.groupby(["path", "specimen"])[quantity].mean()
            for x, path in enumerate(paths):
                values = each.get(path, pandas.Series(dtype=float)).to_numpy()
                at = x + 0.25 * (k - 1)
                axes.plot(np.full(len(values), at), values, ".", color=color, ms=4)
                if len(values):
                    axes.hlines(values.mean(), at - 0.1, at + 0.1, color=color, label=model if x == 0 else None)
        axes.set(yscale="log", ylabel=label, xticks=range(len(paths)), xticklabels=[NAMES[path] for path in paths])
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        axes.yaxis.set_minor_formatter(NullFormatter())
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(MODELS))
    return figure
