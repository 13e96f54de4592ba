"""`./lab boundary-value`: solves the biaxial test on three meshes in each program and writes results/boundary_value."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from analysis.boundary_value.problem import Biaxial
from analysis.boundary_value.report import Solution, figure, numbers, table
from analysis.study import STEPS, Figures, StoredTables, Study, Tables, Values
from labkit.cli.arguments import positive_int
from labkit.errors import InputError
from labkit.io import reporter, write_with_provenance
from labkit.model import Model, read_model, update
from labkit.umat import Library, build, copy_sources, missing_compilers

PROGRAMS = {"scikit-fem": ("skfem", "fem"), "kratos": ("KratosMultiphysics", "kratos")}  # module, extra of labkit


class BoundaryValue(Study):
    """A biaxial test with finite elements."""

    data, rounding = "solutions.json", "%.7g"
    steps = STEPS[2:]

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        program = "finite-element programs (default: those of scikit-fem and Kratos that are installed)"
        parser.add_argument("--program", choices=PROGRAMS, nargs="+", help=program)
        columns = "elements across the specimen, one number per mesh; twice as many along it (default: 8 16 32)"
        parser.add_argument("--columns", type=positive_int, nargs="+", default=[8, 16, 32], help=columns)
        parser.add_argument("--strain", type=float, default=0.01, help="axial strain (default: 0.01)")
        parser.add_argument("--increments", type=positive_int, default=20, help="number of increments (default: 20)")
        python = "use labkit.model.update instead of the compiled law, in scikit-fem"
        parser.add_argument("--python", action="store_true", help=python)
        parameters = "parameter file of the model, as for `labkit model` (default: Table 2)"
        parser.add_argument("--parameters", type=Path, help=parameters)
        super().add_options(parser)

    def main(self, options: argparse.Namespace, command: str) -> int:
        """Solves the problem on every mesh and writes the results; returns 1 if a mesh was not completed.

        Raises InputError if a program or the compilers it needs are not installed.
        """
        if not options.redraw:
            options.program = _programs(options.program, options.python)
            if not 0.0 < options.strain < 0.2:
                raise InputError(field="strain", value=options.strain, allowed="an axial strain from 0 to 0.2")
        return super().main(options, command)

    def prepare(self, options: argparse.Namespace, folder: Path, command: str) -> int:
        solutions = []
        with tempfile.TemporaryDirectory() as scratch:
            for program in options.program:
                model = read_model(options.parameters)
                make = _problem(program, model, options.python, Path(scratch))
                for columns in sorted(set(options.columns)):
                    problem = make(columns)
                    report = reporter(f"{problem.program}, {problem.elements} elements")
                    solutions.append(Solution.of(problem, problem.run(options.strain, options.increments, report)))
        law = "law in Python" if options.python else "compiled law"
        law = f"{options.parameters.name if options.parameters else 'Table 2'}, {law}"
        known = {"law": law, "strain": options.strain, "solutions": [dataclasses.asdict(found) for found in solutions]}
        write_with_provenance(folder / self.data, json.dumps(known) + "\n", command=command)
        return int(any(found.strain[-1] < options.strain * (1 - 1e-9) for found in solutions))

    def read(self, file: Path) -> dict[str, Any]:
        known = json.loads(file.read_text(encoding="utf-8"))
        return known | {"solutions": [Solution(**found) for found in known["solutions"]]}

    def tables(self, data: Mapping[str, Any]) -> Tables:
        return {"biaxial": table(data["solutions"])}

    def figures(self, data: Mapping[str, Any], tables: StoredTables) -> Figures:
        return {"biaxial": figure(data["solutions"], data["strain"])}

    def numbers(self, tables: StoredTables) -> Values:
        return {"rows": tables["biaxial"], **numbers(**self.read(tables.folder / self.data))}


STUDY = BoundaryValue()


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


def _problem(program: str, model: Model, python: bool, scratch: Path) -> Callable[[int], Biaxial]:
    """A function that makes the problem with a number of columns."""
    if program == "kratos":
        from analysis.boundary_value.kratos import InKratos

        return partial(InKratos, library=_compiled(scratch), model=model)
    from analysis.boundary_value.scikit_fem import ScikitFem

    if python:
        return partial(ScikitFem, law=lambda state, increment: update(model, state, increment), model=model)
    return partial(ScikitFem, law=Library(_compiled(scratch), model).update, model=model)


def _compiled(scratch: Path) -> Path:
    """The library of the compiled law."""
    copy_sources(scratch)
    return build(scratch)
