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
    values = {name: value for name, value in fields.values.items() if name != PATH.name}
    if kind is Steps:
        if STEPS not in root:
            fields.error(f"{STEPS} is missing: give a list of steps, see {KIND.page}")
            return None
        values["steps"], values["order"] = read_steps(root[STEPS], STEPS, errors)
    if not errors.count:
        fields.attempt(lambda: make_path(kind.name, _with_units(kind, values)))
    return kind, _with_units(kind, values)


def _with_units(kind: type[Path], values: dict[str, object]) -> dict[str, object]:
    """The values with units where a number alone would be ambiguous."""
    known = options_of(kind)
    return {
        name: f"{value!r} Pa" if isinstance(value, float) and known[name].unit == "Pa" else value
        for name, value in values.items()
    }
