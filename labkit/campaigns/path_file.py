"""Path files: a loading path in YAML, one of labkit's with its parameters, or steps of mixed control.

path: cp                        path: steps
pressure: 300 kPa               pressure: 300 kPa
strain: 5 %                     steps:
                                  - {strain: {zz: 2 %}, stress: {xx: 0, yy: 0}}
"""

from __future__ import annotations

import os
from pathlib import Path as File

from labkit.campaigns.document import Block, Errors, Kind, compose, read_fields, read_text
from labkit.campaigns.keys import PATH, options_of
from labkit.campaigns.steps import STEPS, read_steps
from labkit.errors import InputError
from labkit.parameters import with_units
from labkit.paths.path import Path
from labkit.paths.registry import PATHS, make_path
from labkit.paths.steps import Steps

KIND = Kind("path", "PyYAML", "`path:` and its parameters", "docs/paths.md")
ENDINGS = (".yaml", ".yml")


def is_path_file(name: str) -> bool:
    """True if a word names a path file, not a path."""
    return name.lower().endswith(ENDINGS)


def read_path(file: str | os.PathLike[str]) -> Path:
    """The loading path in a path file. Raises InputError with every error and its line."""
    kind, values = path_values(file)
    return make_path(kind.name, values)


def path_values(file: str | os.PathLike[str]) -> tuple[type[Path], dict[str, object]]:
    """The path that a path file names, and the values of its parameters in SI units.

    Raises InputError with every error and its line.
    """
    file, errors = File(file), Errors()
    root = compose(read_text(file, KIND), errors, KIND)
    found = None if root is None else _values(root, errors)
    if found is None or errors.count:
        raise InputError(errors.report(file))
    return found


def _values(root: Block, errors: Errors) -> tuple[type[Path], dict[str, object]] | None:
    kind = PATHS.get(str(root.get(PATH.name)))
    sections = (STEPS,) if kind is Steps else ()
    known = {PATH.name: PATH, **({} if kind is None else options_of(kind))}
    if kind is Steps:
        del known["order"], known[STEPS]  # the list of steps says both
    if kind is None:
        known |= {name: one for other in PATHS.values() for name, one in options_of(other).items()}
    fields = read_fields(root, known, "the file", errors, sections=sections, line=1)
    fields.require([PATH], example="cv")
    if kind is None:
        return None
    if kind is Steps:
        read_steps(root, fields, STEPS)
    given = {name: value for name, value in fields.values.items() if name != PATH.name}
    values = with_units(kind, given)
    if not errors.count:
        fields.attempt(lambda: make_path(kind.name, values))
    return kind, values
