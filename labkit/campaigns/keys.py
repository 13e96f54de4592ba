"""Keys of a campaign file, name -> Parameter, built from the central parameter table (labkit.parameters)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from labkit.engines import ENGINES
from labkit.engines.device import PRECISIONS
from labkit.grains.scene import MADE_WITH, Scene
from labkit.parameters import Keys, Parameter, options_of, parameter, parameters_of
from labkit.paths.path import Path
from labkit.paths.path_file import PATH
from labkit.paths.registry import PATHS
from labkit.paths.standard import Consolidation
from labkit.records.schedule import Options
from labkit.specimens.recipe import Recipe
from labkit.specimens.settings import SETTINGS

MOST_GRAINS = 100_000  # maximum number of grains per specimen: even this many take hours on one core
MULTIPLIED = {"specimens": ("seed",), "runs": ("specimen", "pressure", "engine")}  # each adds its own suffix


@dataclasses.dataclass(frozen=True)
class Common:
    """Keys allowed in any entry, or at the top of the file as the default for all entries."""

    settings: str = parameter("standard", choices=SETTINGS, help="trade-off between speed and accuracy")
    engine: str = parameter("fused", choices=ENGINES, help="simulation engine")
    threads: int = parameter(1, low=1, high=256, help="number of threads")
    ranks: int = parameter(1, low=1, high=100_000, help="number of MPI ranks of the engine lammps, instead of threads")
    precision: str = parameter("double", choices=PRECISIONS, help="double, or mixed on the engine fused")


NAME = Parameter("name", help="name of the campaign and of its folder", kind=str)
SPECIMEN = Parameter("specimen", help="specimen to start from", kind=str)
FROM = Parameter("from", help="specimen to consolidate", kind=str)


def select(values: Mapping[str, object], kind: type) -> dict[str, Any]:
    """Select the values that are parameters of a dataclass and that a user may set."""
    known = options_of(kind)
    return {name: value for name, value in values.items() if name in known}


def file_keys() -> Keys:
    """Keys at the top of the file, used as defaults: Scene for specimens, Options for runs, Common for both."""
    return {NAME.name: NAME, **options_of(Scene), **options_of(Options), **options_of(Common)}


def specimen_keys() -> Keys:
    """Keys of a specimen to make."""
    known = {**options_of(Recipe), **options_of(Scene), **options_of(Common)}
    return {**known, "grains": dataclasses.replace(known["grains"], high=MOST_GRAINS)}


def consolidated_keys() -> Keys:
    """Keys of a specimen that is consolidated from another specimen."""
    common = options_of(Common)
    known = parameters_of(Consolidation)
    working = {name: common[name] for name in ("engine", "threads", "ranks", "precision")}
    cell = dataclasses.replace(known["cell"], default=None)
    return {FROM.name: FROM, "pressure": known["pressure"], "cell": cell, **working}


def changes_of_runs() -> Keys:
    """Parameters of the Scene that a run may change."""
    return {name: known for name, known in options_of(Scene).items() if name not in MADE_WITH}


def any_run_keys() -> Keys:
    """Keys that every run accepts, whatever its path."""
    return {PATH.name: PATH, SPECIMEN.name: SPECIMEN, **options_of(Options), **changes_of_runs(), **options_of(Common)}


def run_keys(path: type[Path] | None) -> Keys:
    """Return the keys of a run along a path, or along an unknown path (None).

    They include the parameters of all other paths, so that messages can name the path to which a parameter belongs.
    """
    others = {name: known for kind in PATHS.values() for name, known in options_of(kind).items()}
    return {**others, **any_run_keys(), **({} if path is None else options_of(path))}
