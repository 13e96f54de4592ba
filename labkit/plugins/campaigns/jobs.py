"""A job: a task as a value with a JSON form, which any process can execute.

A job names its specimen by the file that contains it; a different job may still have to make this file.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from typing import Any

from labkit.engines import Device
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.parameters import Values, options_of
from labkit.paths.path import Path
from labkit.paths.registry import PATHS
from labkit.records.identity import NAMES
from labkit.records.schedule import Options
from labkit.simulation.cost import CONSOLIDATION_STEPS, Cost, cost_of_run, cost_of_specimen
from labkit.simulation.tasks import ConsolidationTask, RunTask, SpecimenTask
from labkit.specimens.recipe import BEFORE, Recipe


@dataclasses.dataclass(frozen=True, kw_only=True)
class Job:
    """A specimen to make (`recipe`), to consolidate (`pressure`) or to load (`path`); files are relative to a folder.

    Args:
        name: Name of the job and of its result.
        device: Engine, with threads or ranks and precision.
        scene: Scene of the grains.
        grains: Approximate number of grains, or of the spheres of clumps.
        recipe: How to make the specimen.
        source: State or run file of the specimen.
        pressure: Isotropic pressure of a consolidation, Pa.
        cell: Whether the cell of a specimen or of a consolidation is "free" or "fixed".
        path: Loading path.
        options: Options of the run.
        specimen: Name that the user gave the specimen in `source`.
        basis: Digest of the job that makes `source`, and hashes of the user's files on which the result depends.
        use: The user's files to load first.
        command: Equivalent command, for people.
    """

    name: str
    device: Device
    scene: Scene
    grains: int = 0
    recipe: Recipe | None = None
    source: str | None = None
    pressure: float | None = None
    cell: str = BEFORE
    path: Path | None = None
    options: Options = dataclasses.field(default_factory=Options)
    specimen: str = ""
    basis: tuple[str, ...] = ()
    use: tuple[str, ...] = ()
    command: str = ""

    @property
    def kind(self) -> str:
        """`specimen`, `consolidation` or `run`."""
        return "specimen" if self.recipe else "run" if self.path else "consolidation"

    @property
    def loading(self) -> Path:
        """The loading path of a run."""
        assert self.path is not None
        return self.path

    @property
    def cost(self) -> Cost:
        """The estimated cost."""
        if self.recipe is not None:
            return cost_of_specimen(self.recipe, self.scene, self.device, self.grains)
        if self.path is None:
            return Cost(self.device, self.grains, CONSOLIDATION_STEPS)
        return cost_of_run(self.path, self.scene, self.options, self.device, self.grains)

    @functools.cached_property
    def digest(self) -> str:
        """Hash of everything that determines the result; results of fused are the same on any number of threads."""
        values = self._values()
        values.pop("source", None)
        for step in values["path"].get("steps", ()) if self.path is not None and self.path.phases else ():
            for name in NAMES:
                step.pop(name, None)
        if self.device.name == "fused":
            del values["device"]["threads"]
            values["device"].pop("ranks", None)
        return hashlib.sha256(json.dumps([values, *self.basis]).encode()).hexdigest()

    def _values(self) -> Values:
        """The task in JSON values, without defaults."""
        values: Values = {
            "recipe": self.recipe and _recipe_values(self.recipe),
            "source": self.source,
            "scene": changed_values(self.scene),
            "pressure": self.pressure,
            "cell": self.cell if self.kind == "consolidation" and self.cell != BEFORE else None,
            "path": self.path and {"name": self.path.name, **changed_values(self.path)},
            "options": changed_values(self.options),
            "device": {name: value for name, value in vars(self.device).items() if (name, value) != ("ranks", 1)},
        }
        return {name: value for name, value in values.items() if value is not None}

    def to_json(self) -> str:
        """Return the job as JSON."""
        others = ("name", "grains", "specimen", "basis", "use", "command")
        job = {"kind": self.kind, **{name: getattr(self, name) for name in others}}
        return json.dumps({**job, "task": self._values(), "digest": self.digest}, indent=1) + "\n"

    @classmethod
    def from_values(cls, values: Values) -> Job:
        """Return the job from parsed JSON. Raises KeyError or TypeError if it does not describe a job."""
        task = values["task"]
        path = {**task.get("path", {})}
        recipe = Recipe(**{"cell": BEFORE, **task["recipe"]}) if task.get("recipe") else None
        return cls(
            name=values["name"],
            device=Device(**task["device"]),
            scene=Scene(**task["scene"]),
            recipe=recipe,
            cell=task.get("cell", BEFORE) if recipe is None else recipe.cell,
            path=PATHS.require(path.pop("name"))(**path) if path else None,
            options=Options(**task["options"]),
            source=task.get("source"),
            pressure=task.get("pressure"),
            grains=values["grains"],
            specimen=values["specimen"],
            basis=tuple(values["basis"]),
            use=tuple(values["use"]),
            command=values["command"],
        )

    def task(self, output: str) -> SpecimenTask | ConsolidationTask | RunTask:
        """Return the task, which writes `output`. Raises InputError if the source cannot be read, or used."""
        common: Values = {"device": self.device, "output": output, "history": self.command}
        if self.recipe is not None:
            return SpecimenTask(recipe=self.recipe, material=self.scene, **common)
        state = read_state(str(self.source))
        if self.path is not None:
            state = state.replace(scene=self.scene)
            return RunTask(state=state, path=self.path, options=self.options, source=self.source, **common)
        assert self.pressure is not None
        return ConsolidationTask(state=state, source=self.source, pressure=self.pressure, cell=self.cell, **common)


def _recipe_values(recipe: Recipe) -> Values:
    """Return the values of a recipe, with the cell unless it is as in recipes that do not say it."""
    values = changed_values(recipe)
    values.pop("cell", None)
    return values if recipe.cell == BEFORE else {**values, "cell": recipe.cell}


def changed_values(instance: object) -> Values:
    """Return the parameters that users may set and that differ from their defaults, as JSON values."""
    values = {
        name: (getattr(instance, name, None), parameter) for name, parameter in options_of(type(instance)).items()
    }
    return {
        name: _plain(value) for name, (value, parameter) in values.items() if value not in (None, parameter.default)
    }


def _plain(value: Any) -> object:
    """Return a value of a parameter without dataclasses, for JSON."""
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    return dataclasses.asdict(value) if dataclasses.is_dataclass(type(value)) else value
