"""`./lab boundary-value`: solves the biaxial test on three meshes in each program and writes results/boundary_value."""

from __future__ import annotations

import argparse
import importlib.util
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from analysis.boundary_value.problem import Biaxial
from analysis.pages import render
from analysis.places import results_folder
from labkit.cli.arguments import positive_int
from labkit.errors import InputError
from labkit.figures import plots
from labkit.io import make_folder, reporter, write_with_provenance
from labkit.model import Model, update
from labkit.umat import Library, build, copy_sources, missing_compilers

PROGRAMS = {"scikit-fem": ("skfem", "fem"), "kratos": ("KratosMultiphysics", "kratos")}  # module, extra of labkit


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab boundary-value`."""
    parser.add_argument(
        "--program",
        choices=PROGRAMS,
        nargs="+",
        help="finite-element programs (default: those of scikit-fem and Kratos that are installed)",
    )
    parser.add_argument(
        "--columns",
        type=positive_int,
        nargs="+",
        default=[8, 16, 32],
        help="elements across the specimen, one number per mesh; twice as many along it (default: 8 16 32)",
    )
    parser.add_argument("--strain", type=float, default=0.01, help="axial strain (default: 0.01)")
    parser.add_argument("--increments", type=positive_int, default=20, help="number of increments (default: 20)")
    parser.add_argument(
        "--python", action="store_true", help="use labkit.model.update instead of the compiled law, in scikit-fem"
    )
    parser.add_argument(
        "-o",
        "--output",
        default=results_folder("boundary_value"),
        help="folder for the results (default: results/boundary_value)",
    )


def main(options: argparse.Namespace, command: str) -> int:
    """Solves the problem on every mesh and writes the table, figure and page; returns 1 if a mesh was not completed.

    Raises InputError if a program or the compilers it needs are not installed.
    """
    programs = _programs(options.program, options.python)
    if not 0.0 < options.strain < 0.2:
        raise InputError(field="strain", value=options.strain, allowed="an axial strain from 0 to 0.2")
    from analysis.boundary_value.report import Solution, figure, numbers

    folder = Path(make_folder(options.output, "--output"))
    solutions = []
    with tempfile.TemporaryDirectory() as scratch:
        for program in programs:
            make = _problem(program, options.python, Path(scratch))
            for columns in sorted(set(options.columns)):
                problem = make(columns)
                report = reporter(f"{problem.program}, {problem.elements} elements")
                solutions.append(Solution(problem, problem.run(options.strain, options.increments, report)))
        plots.save(figure(solutions, options.strain), folder / "biaxial.png")
        values = numbers(solutions, "law in Python" if options.python else "compiled law", options.strain)
    rows = values["rows"]
    write_with_provenance(folder / "biaxial.csv", rows.to_csv(index=False, float_format="%.7g"), command=command)
    page = render(Path(__file__).with_name("page.md"), values | {"command": command})
    write_with_provenance(folder / "README.md", page, command=command)
    print(rows.to_string(index=False))
    return int(any(solution.history.strain[-1] < options.strain * (1 - 1e-9) for solution in solutions))


def _programs(given: list[str] | None, python: bool) -> list[str]:
    """The programs to be used; raises InputError if one, or the compilers, are missing."""
    if python and given is not None and given != ["scikit-fem"]:
        raise InputError("calls the law in Python, which only scikit-fem can do", field="--python")
    missing = [name for name, (module, _) in PROGRAMS.items() if importlib.util.find_spec(module) is None]
    chosen = given or [name for name in PROGRAMS if name not in missing and not (python and name == "kratos")]
    for name in chosen or PROGRAMS:
        if name in missing:
            raise InputError(f"{name} is not installed: pip install 'labkit[{PROGRAMS[name][1]}]'")
    if not python and missing_compilers():
        missing_here = " and ".join(missing_compilers())
        raise InputError(f"{missing_here} not found: install with apt-get install gfortran gcc, or give --python")
    return chosen


def _problem(program: str, python: bool, scratch: Path) -> Callable[[int], Biaxial]:
    """A function that makes the problem with a number of columns."""
    model = Model()
    if python:
        from analysis.boundary_value.scikit_fem import ScikitFem

        return partial(ScikitFem, law=lambda state, increment: update(model, state, increment), model=model)
    copy_sources(scratch)
    library = build(scratch)
    if program == "kratos":
        from analysis.boundary_value.kratos import InKratos

        return partial(InKratos, library=library, model=model)
    from analysis.boundary_value.scikit_fem import ScikitFem

    return partial(ScikitFem, law=Library(library, model).update, model=model)
