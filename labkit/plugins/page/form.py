"""What the page offers, from labkit's tables, and the tests that the choices of a user make."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from typing import Any

from labkit.engines.base import Progress
from labkit.errors import InputError, as_typed
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.parameters import Parameter, options_of, parameters_of
from labkit.paths.path import Path
from labkit.paths.registry import PATHS, make_path
from labkit.paths.standard import Consolidation
from labkit.simulation.tasks import ConsolidationTask, SpecimenTask, execute
from labkit.specimens.recipe import Recipe

Texts = Mapping[str, Mapping[str, str]]  # what a user typed, by group (recipe, scene, consolidation, path) and name
GROUPS: dict[str, tuple[type, tuple[str, ...]]] = {
    "recipe": (Recipe, ("grains", "void_ratio", "step1_friction", "step1_rolling_friction", "shape", "seed")),
    "scene": (Scene, ("law", "friction", "rolling_friction", "diameter_spread", "grading")),
    "consolidation": (Consolidation, ("pressure",)),
}
MOST_SPHERES = 5_000  # a test to 10 % of so many takes some minutes in a browser
MOST_BYTES = 100_000_000  # of a file; a State of so many grains has some 2 MB
TOO_LARGE = f"this file is too large for a page: give a State of at most {MOST_SPHERES} spheres"


@dataclasses.dataclass(frozen=True)
class Choices:
    """The specimen, the pressure to which it is consolidated (Pa, or text), if any, and the loading path."""

    recipe: Recipe
    scene: Scene
    pressure: str | None
    path: Path

    @classmethod
    def of(cls, texts: Texts) -> Choices:
        """Return the choices from what a user typed. Raises InputError."""
        arguments = {group: _typed(kind, texts.get(group, {})) for group, (kind, _) in GROUPS.items()}
        recipe, scene = Recipe(**arguments["recipe"]), Scene(**arguments["scene"])
        require_number(recipe.expected_spheres(scene))
        return cls(recipe, scene, arguments["consolidation"].get("pressure"), chosen_path(texts))

    def specimen(self, progress: Progress) -> State:
        """Make the specimen. Raises InputError and PhysicsError."""
        state = execute(SpecimenTask(recipe=self.recipe, material=self.scene), progress)
        return state if self.pressure is None else execute(ConsolidationTask(state=state, pressure=self.pressure))


def require_number(spheres: int) -> None:
    """Raise InputError for more spheres than a browser computes in a reasonable time."""
    if spheres > MOST_SPHERES:
        allowed = f"at most {MOST_SPHERES} spheres, or use labkit outside the browser"
        raise InputError("are too many for a page", field="grains", value=spheres, allowed=allowed)


def chosen_path(texts: Texts) -> Path:
    """Return the loading path from what a user typed. Raises InputError."""
    parameters = {**texts.get("path", {})}
    name = parameters.pop("name", "")
    return make_path(name, _typed(PATHS.require(name), parameters))


def offered() -> dict[str, Any]:
    """Return what the page offers, as JSON: the fields of each group, and the paths with their fields."""
    groups = {group: [_field(options_of(kind)[name]) for name in names] for group, (kind, names) in GROUPS.items()}
    paths = {name: _path(PATHS[name]) for name in PATHS if not _needs_a_file(PATHS[name])}
    upload = {"most": MOST_BYTES, "refusal": TOO_LARGE}
    return {"groups": groups, "paths": paths, "upload": upload}


def _typed(kind: type, texts: Mapping[str, str]) -> dict[str, Any]:
    """Return the arguments of a dataclass from texts, without those left empty. Raises InputError."""
    parameters = parameters_of(kind)
    for name in texts:
        if name not in parameters:
            raise InputError(f"is not a parameter of {kind.__name__}: leave it out", field=name)
    return {name: parameters[name].require_unit(text) for name, text in texts.items() if text.strip()}


def _path(kind: type[Path]) -> dict[str, Any]:
    summary = (inspect.getdoc(kind) or "").partition("\n")[0].replace("`", "")
    return {
        "title": summary.partition(":")[0].rstrip("."),
        "summary": summary,
        "fields": [_field(parameter) for parameter in options_of(kind).values()],
    }


def _field(parameter: Parameter) -> dict[str, Any]:
    """Return the name, the meaning, the unit, the default and the choices of a parameter, for the page."""
    absent = parameter.default is None or parameter.default is dataclasses.MISSING
    return {
        "name": parameter.name,
        "words": parameter.name.replace("_", " "),
        "help": parameter.help,
        "unit": "" if parameter.unit == "1" else parameter.unit,
        "default": "" if absent else as_typed(parameter.default),
        "choices": ["True", "False"] if parameter.kind is bool else [*parameter.choices] if parameter.choices else None,
    }


def _needs_a_file(kind: type[Path]) -> bool:
    """Return True for a path whose parameters are objects, which are too long to type."""
    return any(dataclasses.is_dataclass(parameter.kind) for parameter in options_of(kind).values())
