"""`./lab model-evidence`: what the model is worth, from the reduced run files of results/paper."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from analysis.campaigns import save_figures, write_tables
from analysis.critical_state.study import STUDY as CRITICAL_STATE
from analysis.model_evidence.calibrations import calibrate_all
from analysis.model_evidence.errors import combined, error_summary, test_errors
from analysis.model_evidence.figures import error_figure
from analysis.model_evidence.increments import increments
from analysis.model_evidence.inversion import inversion_errors
from analysis.model_evidence.new_tests import new_combined, new_errors, new_tests
from analysis.model_evidence.page import page
from analysis.model_evidence.residuals import forms_of_c4, missing_elements
from analysis.paper import runs, sources
from analysis.paper.ends import ends, in_memory, sheared
from analysis.paper.ends import main as of_the_paper
from analysis.paper.lines import both_lines
from analysis.places import results_folder
from labkit.engines import Progress
from labkit.io import make_folder, reporter, write_with_provenance

FITS = "calibrations.json"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab model-evidence`."""
    parser.add_argument(
        "--paper", default=results_folder("paper"), help="results of ./lab paper (default: results/paper)"
    )
    parser.add_argument(
        "--new",
        default=os.path.join(results_folder("critical_state"), CRITICAL_STATE.data),
        help="data set of ./lab critical-state, whose tests no model was fitted to (default: the stored one)",
    )
    parser.add_argument(
        "--refit",
        action="store_true",
        help="repeat the calibrations, about 20 minutes on one core, instead of reading them",
    )
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("model_evidence"),
        help="output folder (default: results/model_evidence)",
    )


def main(options: argparse.Namespace, command: str) -> None:
    """Writes all tables, the figure and the page."""
    folder = Path(make_folder(options.output, "--output"))
    if options.refit:
        (folder / FITS).unlink(missing_ok=True)
    for file in write(Path(options.paper), Path(options.new), folder, command, reporter("model")):
        print(file)


def write(paper: Path, new: Path, folder: Path, command: str, progress: Progress) -> Iterator[Path]:
    """Writes the results from the reduced run files in `paper`; yields the files. Fits only what is not stored.

    new: data set of ./lab critical-state; without it the models are not compared with new tests.
    """
    stored = runs(paper)
    known = of_the_paper(in_memory(stored))
    calibrations = calibrate_all(known, folder / FITS, lambda share, text: progress(0.7 * share, text))
    progress(0.7, "comparing the models with the tests")
    errors = test_errors(known, calibrations)
    progress(0.85, "fitting the increments")
    data, fitted = increments(known), both_lines(ends(sheared(known)))
    monotonic = {name: run for name, run in known.items() if run.attrs["path"] != "cyclic_cp"}
    tables = {
        "errors": errors,
        "summary": error_summary(errors),
        "combined": combined(errors),
        "missing_elements": missing_elements(data, fitted),
        "forms_of_c4": forms_of_c4(data, fitted),
        "inversion": inversion_errors(monotonic),
    }
    files = sources(stored)
    if new.exists():
        progress(0.9, "comparing the models with new tests")
        found = new_errors(new_tests(xr.load_dataset(new)), calibrations)
        tables |= {"new_errors": found, "new_summary": error_summary(found), "new_combined": new_combined(found)}
        files = [*files, str(new)]
    yield from write_tables(tables, folder, files, command)
    yield from save_figures({"errors": error_figure(errors)}, folder, files, command)
    write_with_provenance(folder / "README.md", page(tables, command), files, command)
    yield folder / "README.md"
    progress(1.0, "done")
