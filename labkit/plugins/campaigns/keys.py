"""Keys of a campaign file, name -> Parameter, built from the central parameter table, and how an entry is read."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping

from labkit.engines import ENGINES
from labkit.engines.device import PRECISIONS
from labkit.grains.scene import MADE_WITH, Scene
from labkit.parameters import Keys, Parameter, Values, options_of, parameters_of
from labkit.paths.path import Path
from labkit.paths.path_file import PATH
from labkit.paths.registry import PATHS
from labkit.paths.standard import Consolidation
from labkit.records.schedule import Options
from labkit.specimens.recipe import SETTINGS, Recipe
from labkit.text.document import Block, Entry, Errors, Fields, Node, Rows, kind_of, read_fields
from labkit.text.labels import first_of

MOST_GRAINS = 100_000  # maximum number of grains per specimen: even this many take hours on one core
MULTIPLIED = {"specimens": ("seed",), "runs": ("specimen", "pressure", "engine")}  # each adds its own suffix
COMMON: Keys = {  # in any entry, or at the top of the file as the default for all entries
    "settings": Parameter("settings", "standard", "trade-off between speed and accuracy", kind=str, choices=SETTINGS),
    "engine": Parameter("engine", "fused", "simulation engine", kind=str, choices=ENGINES),
    "threads": Parameter("threads", 1, "number of threads", kind=int, low=1, high=256),
    "ranks": Parameter("ranks", 1, "number of MPI ranks (fused, lammps)", kind=int, low=1, high=100_000),
    "precision": Parameter("precision", "double", "double, or mixed on the engine fused", kind=str, choices=PRECISIONS),
}
NAME = Parameter("name", help="name of the campaign and of its folder", kind=str)
SPECIMEN = Parameter("specimen", help="specimen to start from", kind=str)
FROM = Parameter("from", help="specimen to consolidate", kind=str)
PAIRS = "pairs"  # key of an entry: values that belong together, instead of all combinations


def select(values: Mapping[str, object], kind: type) -> Values:
    """Select the values that are parameters of a dataclass and that a user may set."""
    parameters = options_of(kind)
    return {name: value for name, value in values.items() if name in parameters}


def file_keys() -> Keys:
    """Keys at the top of the file, used as defaults: Scene for specimens, Options for runs, COMMON for both."""
    return {NAME.name: NAME, **options_of(Scene), **options_of(Options), **COMMON}


def specimen_keys() -> Keys:
    """Keys of a specimen to make."""
    parameters = {**options_of(Recipe), **options_of(Scene), **COMMON}
    return {**parameters, "grains": dataclasses.replace(parameters["grains"], high=MOST_GRAINS)}


def consolidated_keys() -> Keys:
    """Keys of a specimen that is consolidated from another specimen."""
    parameters = parameters_of(Consolidation)
    cell = dataclasses.replace(parameters["cell"], default=None)
    working = {name: parameter for name, parameter in COMMON.items() if name != "settings"}
    return {FROM.name: FROM, "pressure": parameters["pressure"], "cell": cell, **working}


def changes_of_runs() -> Keys:
    """Parameters of the Scene that a run may change."""
    return {name: parameter for name, parameter in options_of(Scene).items() if name not in MADE_WITH}


def any_run_keys() -> Keys:
    """Keys that every run accepts, whatever its path."""
    return {PATH.name: PATH, SPECIMEN.name: SPECIMEN, **options_of(Options), **changes_of_runs(), **COMMON}


def run_keys(path: type[Path] | None) -> Keys:
    """Return the keys of a run along a path, or along an unknown path (None).

    They include the parameters of all other paths, so that messages can name the path to which a parameter belongs.
    """
    others = {name: parameter for kind in PATHS.values() for name, parameter in options_of(kind).items()}
    return {**others, **any_run_keys(), **({} if path is None else options_of(path))}


def read_entry(entry: Entry, what: str, keys: Keys, errors: Errors, sections: Collection[str] = ()) -> Fields:
    """Read an entry whose keys, but `path`, may be lists, and its `pairs`; `sections` are read elsewhere."""
    name, line, node = entry
    several = [key for key in keys if key != PATH.name]
    fields = read_fields(node, keys, f"{what} {name}", errors, several, (*sections, PAIRS), line)
    _read_pairs(node, keys, fields)
    return fields


def _read_pairs(node: Node, keys: Keys, fields: Fields) -> None:
    """Read `pairs`, a list of mappings whose values belong together, into the Fields of the mapping `node`."""
    if not isinstance(node, Block) or PAIRS not in node:
        return
    rows, where = node[PAIRS], f"{fields.where}: {PAIRS}"
    if not isinstance(rows, Rows) or not rows:
        fields.error(
            f"{PAIRS} is {kind_of(rows)}: give a list, e.g. - {{void_ratio: 0.62, step1_friction: 0.05}}", PAIRS
        )
        fields.broken.add(PAIRS)
        return
    fields.pairs = [read_fields(row, keys, f"{where}, row {n}", fields.errors) for n, row in enumerate(rows, 1)]
    for row in fields.pairs:
        for name in row.lines:
            if fields.has(name):
                row.error(f"{name} is also given outside of {PAIRS}: give it once", name)
    valid = [row for row in fields.pairs if row.values]
    if len({first_of(row, list(keys)) for row in valid}) < len(valid):
        fields.error(f"{PAIRS} lists the same values twice: leave one row out", PAIRS)
        fields.broken.add(PAIRS)
