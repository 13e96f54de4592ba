"""`./lab boundary-value`: solves the biaxial test on three meshes and writes results/boundary_value."""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from pathlib import Path

from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.errors import InputError
from labkit.io import make_folder, reporter, write_with_provenance
from labkit.model import Model, update
from labkit.umat import Library, build, copy_sources, missing_compilers
from labkit.visuals import plots


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab boundary-value`."""
    parser.add_argument(
        "--columns",
        type=positive_int,
        nargs="+",
        default=[8, 16, 32],
        help="elements across the specimen, one number per mesh; twice as many along it (default: 8 16 32)",
    )
    parser.add_argument("--strain", type=float, default=0.01, help="axial strain (default: 0.01)")
    parser.add_argument("--increments", type=positive_int, default=20, help="number of increments (default: 20)")
    parser.add_argument("--python", action="store_true", help="use labkit.model.update instead of the compiled law")
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("boundary_value"),
        help="folder for the results (default: results/boundary_value)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Solves the problem on every mesh and writes the table, figure and page; returns 1 if a mesh was not completed."""
    if importlib.util.find_spec("skfem") is None:
        raise InputError("scikit-fem is not installed: pip install 'labkit[fem]'")
    if not 0.0 < options.strain < 0.2:
        raise InputError(field="strain", value=options.strain, allowed="an axial strain from 0 to 0.2")
    from analysis.boundary_value.biaxial import Biaxial
    from analysis.boundary_value.report import figure, page, table

    folder = Path(make_folder(options.output, "--output"))
    model = Model()
    with tempfile.TemporaryDirectory() as scratch:
        law, name = _law(options.python, Path(scratch), model)
        problems, histories = {}, {}
        for columns in sorted(set(options.columns)):
            problem = Biaxial(columns, law, model)
            histories[columns] = problem.run(options.strain, options.increments, reporter(f"{columns} columns"))
            problems[columns] = problem
    finest = max(problems)
    rows = table(problems, histories)
    plots.save(figure(problems[finest], options.strain, histories), folder / "biaxial.png")
    write_with_provenance(folder / "biaxial.csv", rows.to_csv(index=False, float_format="%.6g"), command=command)
    text = page(rows, histories[finest], name, options.strain, command)
    write_with_provenance(folder / "README.md", text, command=command)
    print(rows.to_string(index=False))
    return int(any(history.strain[-1] < options.strain * (1 - 1e-9) for history in histories.values()))


def _law(python, scratch, model):
    """(law, its description): Python's update, or the compiled law where compilers are installed."""
    if python or missing_compilers():
        return (lambda state, increment: update(model, state, increment)), "law in Python"
    copy_sources(scratch)
    return Library(build(scratch), model).update, "compiled law"
