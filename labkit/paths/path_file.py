"""Path files: a registered loading path with its parameters, or steps of mixed control, in YAML.

path: cp                        path: steps
pressure: 300 kPa               pressure: 300 kPa
strain: 5 %                     steps:
                                  - {strain: {zz: 2 %}, stress: {xx: 0, yy: 0}}

The steps of a path, here or in a campaign, are named increments of stress and strain:

steps:
  - strain: {zz: 2 %}                      # drained triaxial compression: the lateral stresses stay constant
    stress: {xx: 0, yy: 0}
    until: q/p > 0.8
  - repeat: 10
    steps:
      - {stress: {q: -40 kPa}, variables: roscoe}       # undrained: v is not named, so it stays constant
      - {stress: {q: 40 kPa}, variables: roscoe}
  - table: loading.csv                     # rows of values to reach; columns such as `strain_zz [%]`, `stress_xx [kPa]`
"""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path as File

import numpy as np

from labkit.errors import InputError, require_file_name
from labkit.parameters import Parameter, Values, options_of, parameter, parameters_of
from labkit.paths.mixed_step import MixedStep
from labkit.paths.path import Path
from labkit.paths.registry import PATHS, make_path
from labkit.paths.steps import MOST_STEPS, Steps
from labkit.paths.variables import VARIABLES, Changes, increments
from labkit.text.document import Block, Errors, Fields, Kind, Node, Rows, compose, read_fields, read_text
from labkit.text.reading import read_table, text_of
from labkit.units import UNITS

PATH = Parameter("path", help="loading path", kind=str, choices=PATHS)
STEPS, REPEAT = "steps", "repeat"
DEEPEST = 5  # nested levels of repetitions
KIND = Kind("path", "PyYAML", "`path:` and its parameters", "docs/paths.md")
ENDINGS = (".yaml", ".yml")
COLUMN = re.compile(r"(?P<kind>stress|strain)_(?P<name>\w+)( *\[(?P<unit>[^]]+)\])?")  # heading of a column of a table


def is_path_file(name: str) -> bool:
    """Return True if a word is the name of a path file, not the name of a path."""
    return name.lower().endswith(ENDINGS)


def read_path(file: str | os.PathLike[str]) -> Path:
    """Read the loading path in a path file. Raises InputError with every error and its line."""
    require_file_name(file, "labkit.read_path('path.yaml')")
    kind, values = path_values(file)
    return make_path(kind.name, values)


def path_values(file: str | os.PathLike[str]) -> tuple[type[Path], Values]:
    """Return the path class that a path file names, and the parameter values in SI units.

    Raises InputError with every error and its line.
    """
    file, errors = File(file), Errors(File(file).parent)
    root = compose(read_text(file, KIND), errors, KIND)
    values = None if root is None else _values(root, errors)
    if values is None or errors.count:
        raise InputError(errors.report(file))
    return values


def _values(root: Block, errors: Errors) -> tuple[type[Path], Values] | None:
    kind = PATHS.get(str(root.get(PATH.name)))
    sections = (STEPS,) if kind is Steps else ()
    parameters = {PATH.name: PATH, **({} if kind is None else options_of(kind))}
    if kind is Steps:
        del parameters["order"], parameters[STEPS]  # the keys of the file define both fields
    if kind is None:
        parameters |= {name: parameter for other in PATHS.values() for name, parameter in options_of(other).items()}
    fields = read_fields(root, parameters, "the file", errors, sections=sections, line=1)
    fields.require([PATH], example="cv")
    if kind is None:
        return None
    if kind is Steps:
        read_steps(root, fields, STEPS)
    values = {name: value for name, value in fields.values.items() if name != PATH.name}
    if not errors.count:
        fields.attempt(make_path, kind.name, values)
    return kind, values


@dataclasses.dataclass(frozen=True)
class _Keys:
    """Keys of a step apart from `stress` and `strain`."""

    variables: str = parameter("cartesian", choices=VARIABLES, help="names of stresses and strains")
    absolute: bool = parameter(False, help="stresses are values to reach, not increments")
    over: float | None = parameter(None, above=0.0, high=50.0, help="accumulated strain of the step")
    until: str | None = parameter(None, kind=str, help="condition that ends the step")
    records: int | None = parameter(None, low=1, high=100_000, kind=int, help="number of records")
    label: str = parameter("", help="name of the step in messages")
    table: str | None = parameter(None, kind=str, help="CSV file of stresses and strains, instead of increments")


def read_steps(node: Node, fields: Fields, where: str) -> None:
    """Read the list of steps into the fields `steps`, each step once, and `order`; adds every error with its line.

    Args:
        node: The mapping that has the list `steps`.
        fields: Fields of the path.
        where: Name of the list in messages.
    """
    before, steps = fields.errors.count, list[MixedStep]()
    if not isinstance(node, Block) or STEPS not in node:
        fields.error(f"{STEPS} is missing: give a list of steps, see docs/paths.md")
    else:
        order = _read_list(node[STEPS], where, fields.errors, steps, 0)
        if len(order) > MOST_STEPS:
            fields.errors.add(node[STEPS].line, f"{where} makes {len(order)} steps: give at most {MOST_STEPS}")
        fields.values |= {STEPS: tuple(steps), "order": tuple(order)}
    if fields.errors.count > before:
        fields.broken.add(STEPS)


def _read_list(node: Node, where: str, errors: Errors, steps: list[MixedStep], depth: int) -> list[int]:
    if not isinstance(node, Rows) or not node:
        errors.add(node.line, f"{where} is not a list of steps: write each step after a dash, see docs/paths.md")
        return []
    order: list[int] = []
    for number, item in enumerate(node, start=1):
        name = f"{where}, step {number}"
        if isinstance(item, Block) and REPEAT in item:
            order += _read_repeat(item, name, errors, steps, depth)
        else:
            order += _single(item, name, errors, steps)
    return order


def _read_repeat(node: Block, where: str, errors: Errors, steps: list[MixedStep], depth: int) -> list[int]:
    times = Parameter(REPEAT, kind=int, low=1, high=MOST_STEPS)
    fields = read_fields(node, {REPEAT: times}, where, errors, sections=(STEPS,))
    if STEPS not in node or depth == DEEPEST:
        text = f"nests more than {DEEPEST} repetitions" if STEPS in node else "has nothing to repeat"
        fields.error(f"{text}: give `repeat` a list of `steps`")
        return []
    once = _read_list(node[STEPS], where, errors, steps, depth + 1)
    number = fields.values.get(REPEAT, 1)
    if number * len(once) > MOST_STEPS:
        fields.error(f"makes {number * len(once)} steps: give at most {MOST_STEPS}", REPEAT)
        return []
    return once * number


def _single(node: Node, where: str, errors: Errors, steps: list[MixedStep]) -> list[int]:
    before = errors.count
    fields = read_fields(node, parameters_of(_Keys), where, errors, sections=("stress", "strain"))
    parts = node if isinstance(node, Block) else Block()
    variables = VARIABLES[fields.values.get("variables", "cartesian")]
    changes: dict[str, Changes] = {
        name: _changes(parts.get(name), f"{where}: {name}", errors, names, unit)
        for name, names, unit in (("stress", variables.stress, "Pa"), ("strain", variables.strain, "1"))
    }
    if table := fields.values.pop("table", None):
        file, absolute = errors.folder / table, fields.values.get("absolute", False)
        if changes["stress"] or changes["strain"]:
            fields.error("has increments and a table: give one of them")
        else:
            changes = fields.attempt(lambda: _read_table(file, absolute)) or changes
    elif errors.count == before and not (changes["stress"] or changes["strain"]):
        fields.error("changes nothing: give `stress`, `strain` or `table`, e.g. strain: {zz: 2 %}")
    if errors.count > before:
        return []
    values: Values = {"label": f"step in line {fields.line}", **changes, **fields.values}
    step = fields.attempt(lambda: increments(**values))
    if step is None:
        return []
    steps.append(step)
    return [len(steps) - 1]


def _read_table(file: File, absolute: bool) -> dict[str, Changes]:
    """Read the rows of a step: changes from row to row of a table, or stresses to reach if `absolute`."""
    try:
        table = read_table(text_of(file, "give a table"), file, least=1)
    except InputError as error:
        raise InputError(f"cannot be read as a table of numbers ({error})", field="table", value=str(file)) from None
    numbers = table.numbers(file)
    if np.isnan(numbers).any():
        row = table.lines[int(np.argmax(np.isnan(numbers).any(axis=1)))]
        problem = f"cannot be read as a table of numbers (line {row})"
        raise InputError(problem, field="table", value=str(file))
    changes: dict[str, dict[str, list[float]]] = {"stress": {}, "strain": {}}
    for heading, column in zip(table.names or ["no name"], numbers.T, strict=False):
        parts = COLUMN.fullmatch(heading)
        if parts is None or len(numbers) < 2:
            allowed = "two rows or more, and columns such as `stress_xx [kPa]` and `strain_zz [%]`"
            raise InputError(f"has the column {heading!r} and {len(numbers)} rows", field="table", allowed=allowed)
        kind, name, unit = parts["kind"], parts["name"], parts["unit"] or ""
        parameter = Parameter(name, unit="Pa" if kind == "stress" else "1", is_strain=kind == "strain")
        if name in changes[kind]:
            raise InputError(f"has two columns of {kind}_{name}", field="table", allowed="one of them")
        if not unit and any(parameter.doubt(f"{value:g}") for value in column):
            allowed = f"`{kind}_{name} [{'%' if kind == 'strain' else 'kPa'}]` or another unit"
            raise InputError(f"has the column {heading!r} without a unit", field="table", allowed=allowed)
        try:
            values = parameter.read(f"1 {unit}".strip()) * column
        except InputError:
            allowed = f"one of {', '.join(UNITS[parameter.unit])}"
            problem = f"has the column {heading!r}, whose unit {unit!r} is unknown"
            raise InputError(problem, field="table", allowed=allowed) from None
        changes[kind][name] = (values[1:] if absolute and kind == "stress" else np.diff(values)).tolist()
    return dict(changes)


def _changes(node: Node | None, where: str, errors: Errors, names: tuple[str, ...], unit: str) -> dict[str, float]:
    """Read changes of named stresses or strains, in SI units."""
    if node is None:
        return {}
    parameters = {name: Parameter(name, unit=unit, is_strain=unit == "1") for name in names}
    return read_fields(node, parameters, where, errors).values
