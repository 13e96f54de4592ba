"""A job: a task as a value with a JSON form, which any process can execute.

A job names its specimen by the file that contains it; a different job may still have to make this file. The equivalent
command (`words_of`) is for provenance and people; labkit never reads it.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

from labkit.engines import Device
from labkit.errors import option_name
from labkit.grains.scene import Scene
from labkit.grains.state_file import read_state
from labkit.parameters import LARGE_STRAIN, Parameter, Values, options_of
from labkit.paths.path import Path
from labkit.paths.registry import PATHS
from labkit.plugins.campaigns import keys
from labkit.records.checkpoint import NAMES
from labkit.records.schedule import Options
from labkit.simulation.cost import CONSOLIDATION_STEPS, Cost, cost_of_run, cost_of_specimen
from labkit.simulation.tasks import ConsolidationTask, RunTask, SpecimenTask
from labkit.specimens.recipe import BEFORE, Recipe

PARTS: dict[str, Callable[..., Any]] = {"recipe": Recipe, "scene": Scene, "options": Options, "device": Device}
ABOUT = ("name", "grains", "specimen", "basis", "use", "command")


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
        files: Text files from which the job was planned, such as a sieve curve, path -> SHA-256, for provenance.
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
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
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
        for step in values["path"].get("steps", ()) if self.path is not None and self.path.has_programmes else ():
            for name in NAMES:
                step.pop(name, None)
        if self.device.name == "fused":
            del values["device"]["threads"]
            values["device"].pop("ranks", None)
        return hashlib.sha256(json.dumps([values, *self.basis]).encode()).hexdigest()

    def _values(self) -> Values:
        """The task in JSON values, without defaults."""
        values: Values = {
            "recipe": self.recipe and changed_values(self.recipe),
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
        about = {name: getattr(self, name) for name in ABOUT} | ({"files": self.files} if self.files else {})
        return json.dumps({"kind": self.kind, **about, "task": self._values(), "digest": self.digest}, indent=1) + "\n"

    @classmethod
    def from_values(cls, values: Values) -> Job:
        """Return the job from parsed JSON. Raises KeyError or TypeError if it does not describe a job."""
        about: Values = {name: tuple(values[name]) if name in ("basis", "use") else values[name] for name in ABOUT}
        task = {**values["task"]}
        path = {**task.pop("path", {})}
        if "recipe" in task:
            task["recipe"] = {"cell": BEFORE, **task["recipe"]}
            task["cell"] = task["recipe"]["cell"]
        parts = {name: kind(**task.pop(name)) for name, kind in PARTS.items() if name in task}
        about["files"] = values.get("files", {})
        return cls(**about, **parts, **task, path=PATHS.require(path.pop("name"))(**path) if path else None)

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


def changed_values(instance: object) -> Values:
    """Return the parameters that users may set and that differ from their defaults, as JSON values."""
    values: Values = {}
    for name, parameter in options_of(type(instance)).items():
        default = BEFORE if name == "cell" and isinstance(instance, Recipe) else parameter.default
        if (value := getattr(instance, name, None)) not in (None, default):
            values[name] = [_plain(part) for part in value] if isinstance(value, tuple) else value
    return values


def _plain(value: Any) -> object:
    """Return an entry of a list without dataclasses, for JSON."""
    return dataclasses.asdict(value) if dataclasses.is_dataclass(type(value)) else value


VERBS = {"specimen": "specimen", "consolidation": "consolidate", "run": "run"}


def words_of(job: Job, scene: Scene | None = None) -> list[str]:
    """Return the words of a job's command after `labkit`, without its output; `scene`: the Scene of its source."""
    before = [] if job.source is None else [job.source]
    if job.recipe is not None:
        words = _options(options_of(Recipe), vars(job.recipe))
        words += _options(options_of(Scene), job.scene.values(), Scene().values())
    elif job.path is not None:
        parameters = options_of(type(job.path))
        before = [job.path.name, *before]
        words = _options(
            parameters, vars(job.path), {name: parameter.default for name, parameter in parameters.items()}
        )
        words += _options(options_of(Options), vars(job.options))
        words += _options(keys.changes_of_runs(), job.scene.values(), {} if scene is None else scene.values())
    else:
        words = [f"--pressure={_text(job.pressure, 'Pa')}", f"--cell={job.cell}"]
    device = job.device
    counts = [("threads", device.threads), ("ranks", device.ranks)]
    words += [f"--engine={device.name}"]
    words += [f"--{name}={n}" for name, n in counts if n > 1 or name == device.kind.abilities.parallel[0]]
    return [VERBS[job.kind], *before, *words, *[f"--precision={device.precision}"] * (device.precision != "double")]


def _options(
    parameters: Mapping[str, Parameter], values: Mapping[str, object], defaults: Mapping[str, object] = {}
) -> list[str]:
    """Return command-line options for the values that are not None and differ from the defaults."""
    return [
        f"{option_name(name)}={_text(values[name], 'strain' if parameter.strain else parameter.unit)}"
        for name, parameter in parameters.items()
        if values.get(name) is not None and (name not in defaults or values[name] != defaults[name])
    ]


def _text(value: object, unit: str) -> str:
    """Format a value as the text of an option, with all digits; a pressure and a large strain include their units."""
    if isinstance(value, tuple) and value and not isinstance(value[0], float | int):
        return json.dumps([dataclasses.asdict(part) for part in value])
    if isinstance(value, tuple):
        return ",".join(_text(part, unit) for part in value)
    if unit == "Pa" and isinstance(value, float):
        return f"{value!r}{unit}"
    if unit == "strain" and isinstance(value, float) and abs(value) > LARGE_STRAIN:
        return f"{100.0 * value!r}%"
    return value if isinstance(value, str) else repr(value)
