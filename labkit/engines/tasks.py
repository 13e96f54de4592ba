"""Tasks: a specimen, a layer, a consolidation, a rest, a run or several runs, each a value that any engine can execute.

`execute` runs a task in this process, or in another one if the engine needs that, e.g. in YADE. It then passes the task
on as JSON with a state file, and receives the result as a file.
"""

from __future__ import annotations

import abc
import dataclasses
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path as File
from typing import Any, ClassVar

from labkit.dem import compression, consolidation, probes, simulation, specimen, stratified
from labkit.dem.engine import Engine, Progress, Start, silent
from labkit.dem.interim import interim_of
from labkit.dem.limits import rate_warning, require_pressure
from labkit.dem.paths import Path, path_of
from labkit.dem.recorded import recorded
from labkit.dem.scene import Scene
from labkit.dem.servo import Servo
from labkit.dem.simulation import Options
from labkit.dem.specimen import Recipe
from labkit.dem.state import State, read_state, write_state
from labkit.dem.stratified import Layer
from labkit.engines import ENGINES, require_engine, starter
from labkit.errors import InputError, PhysicsError
from labkit.extensions import file_of, is_labkits, use, used
from labkit.io.blas import one_blas_thread
from labkit.io.interruption import being_written, busy
from labkit.io.provenance import provenance
from labkit.parameters import restored


@dataclasses.dataclass(frozen=True)
class Task(abc.ABC):
    """A job for an engine.

    engine: its name; threads: their number, or that of the MPI ranks; precision; output: file to write; history: the
    command.
    """

    engine: str = "fused"
    threads: int = 1
    precision: str = "double"
    output: str | None = None
    history: str = ""

    kind: ClassVar[str]

    @property
    @abc.abstractmethod
    def scene(self) -> Scene:
        """Scene of the grains."""

    @property
    def start(self) -> Start:
        """What starts the engine."""
        return starter(self.engine, self.threads, self.precision)

    @abc.abstractmethod
    def do(self, progress: Progress) -> State | None:
        """Run the task in this process; return the resulting State, or None for a run."""

    @abc.abstractmethod
    def values(self, folder: File) -> dict[str, Any]:
        """Return everything that determines the result, as JSON; a State is written to a file in `folder`."""

    @classmethod
    @abc.abstractmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> Task:
        """Build the task from the result of `values`; `common`: engine, threads, precision, output, history."""

    def with_origin(self, state: State, inputs: tuple[str, ...]) -> State:
        """Return the State with the history and provenance of this task."""
        history = "\n".join(line for line in (state.history, self.history) if line)
        made = provenance(self.history or None, (*inputs, *used()), self.output, state.seed)
        return state.replace(history=history, provenance=made)

    def finished(self, state: State, inputs: tuple[str, ...] = ()) -> State:
        """Return the State with its origin; write it to `output` if that is set."""
        state = self.with_origin(state, inputs)
        if self.output is not None:
            write_state(self.output, state)
        return state


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpecimenTask(Task):
    """Make a specimen."""

    recipe: Recipe
    material: Scene

    kind = "specimen"

    @property
    def scene(self) -> Scene:
        return self.material

    def do(self, progress: Progress) -> State:
        make = compression.compress_gas if self.recipe.preparation == "compression" else specimen.make_specimen
        return self.finished(make(self.material, self.recipe, self.start, progress))

    def values(self, folder: File) -> dict[str, Any]:
        return {"recipe": dataclasses.asdict(self.recipe), "scene": dataclasses.asdict(self.material)}

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> SpecimenTask:
        return cls(recipe=restored(Recipe, values["recipe"]), material=restored(Scene, values["scene"]), **common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LayerTask(Task):
    """Make the stratified layer of Fig. 3."""

    layer: Layer

    kind = "layer"

    @property
    def scene(self) -> Scene:
        return Scene(planar=True)

    def do(self, progress: Progress) -> State:
        return self.finished(stratified.make_layer(self.layer, self.start, progress))

    def values(self, folder: File) -> dict[str, Any]:
        return {"layer": dataclasses.asdict(self.layer)}

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> LayerTask:
        return cls(layer=restored(Layer, values["layer"]), **common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class _OfState(Task):
    """A task that starts from a State. source: the file of that State, if any."""

    state: State
    source: str | None = None

    @property
    def scene(self) -> Scene:
        return self.state.scene

    @property
    def inputs(self) -> tuple[str, ...]:
        return () if self.source is None else (self.source,)

    def values(self, folder: File) -> dict[str, Any]:
        file = folder / "specimen.state.nc"
        write_state(file, self.state)
        return {"specimen": str(file), "source": self.source}

    @staticmethod
    def of(values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fields of this class, read from the result of `values`."""
        return {"state": read_state(values["specimen"]), "source": values["source"]}


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConsolidationTask(_OfState):
    """Consolidate a specimen to an isotropic pressure, Pa."""

    pressure: float

    kind = "consolidation"

    def do(self, progress: Progress) -> State:
        interim = interim_of(self.output)
        state = consolidation.consolidate(self.state, self.pressure, self.start, progress, interim)
        return self.finished(state, self.inputs)

    def values(self, folder: File) -> dict[str, Any]:
        return {**super().values(folder), "pressure": self.pressure}

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> ConsolidationTask:
        return cls(**cls.of(values), pressure=values["pressure"], **common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RestTask(_OfState):
    """Let the grains of a specimen come to rest in their fixed cell, as closely as probes need."""

    kind = "rest"

    def do(self, progress: Progress) -> State:
        return self.finished(probes.rest(self.state, self.start, progress), self.inputs)

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> RestTask:
        return cls(**cls.of(values), **common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunTask(_OfState):
    """Load a specimen along a path and write the run file `output`; resume that file if it is unfinished."""

    path: Path
    options: Options = dataclasses.field(default_factory=Options)

    kind = "run"

    @property
    def warning(self) -> str | None:
        """What is likely to be wrong with the rate of the run, one sentence."""
        return rate_warning(self.path, self.state, self.options.inertial_number)

    def do(self, progress: Progress) -> None:
        self.do_with(self.start, progress)

    def do_with(self, start: Start, progress: Progress) -> None:
        """Do the task with engines from `start`."""
        if self.output is None:
            raise InputError("a run needs an output file: set `output`")
        require_pressure(self.path, self.scene)
        state = self.with_origin(self.state, self.inputs)
        simulation.run(state, self.path, File(self.output), start, self.options, progress)

    def values(self, folder: File) -> dict[str, Any]:
        known = {"path": self.path.name, "parameters": self.path.parameters()}
        return {**super().values(folder), **known, "options": dataclasses.asdict(self.options)}

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> RunTask:
        path = _known_path(values["path"], values["parameters"])
        options = Options(**{**values["options"], "servo": Servo(**values["options"]["servo"])})
        return cls(**cls.of(values), path=path, options=options, **common)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProbesTask(_OfState):
    """Load the same specimen along each of `paths`; write the run files 0.run.nc, 1.run.nc, ... to the folder `output`.

    Only the start and the end of each path are recorded.
    """

    paths: tuple[Path, ...]

    kind = "probes"

    def do(self, progress: Progress) -> None:
        if self.output is None:
            raise InputError("probes need an output folder: set `output`")
        for number, path in enumerate(self.paths):
            progress(number / len(self.paths), f"probe {number + 1} of {len(self.paths)}")
            options = Options(record_strain=abs(path.strain), snapshots=1)
            simulation.run(self.state, path, File(self.output) / f"{number}.run.nc", self.start, options)
        progress(1.0, "done")

    def values(self, folder: File) -> dict[str, Any]:
        return {**super().values(folder), "paths": [(path.name, path.parameters()) for path in self.paths]}

    @classmethod
    def from_values(cls, values: Mapping[str, Any], common: Mapping[str, Any]) -> ProbesTask:
        paths = tuple(_known_path(name, parameters) for name, parameters in values["paths"])
        return cls(**cls.of(values), paths=paths, **common)


def _known_path(name: str, parameters: Mapping[str, Any]) -> Path:
    """The path of that name. Raises InputError if it is not registered in this process."""
    path = path_of(name, parameters)
    if path is None:
        raise InputError(f"path {name!r} is unknown in this process: define it in a file and load that with --use")
    return path


_TASKS: tuple[type[Task], ...] = (SpecimenTask, LayerTask, ConsolidationTask, RestTask, RunTask, ProbesTask)
KINDS: dict[str, type[Task]] = {kind.kind: kind for kind in _TASKS}


def require_possible(task: Task) -> type[Engine]:
    """The class of the engine of a task. Raises InputError if it cannot execute the task, or not on this computer."""
    kind = require_engine(task.engine, task.scene, task.precision)
    for path in _paths(task):
        kind.require_path(path.for_scene(task.scene))
    kind.require_here()
    return kind


def execute(task: Task, progress: Progress = silent) -> State | None:
    """Run a task in the process that its engine needs; return the resulting State, or None for runs.

    Raises InputError, PhysicsError or Interrupted, in either process.
    """
    kind = require_possible(task)
    if kind.here():
        with one_blas_thread():
            return task.do(progress)
    if isinstance(task, RunTask) and being_written(File(str(task.output))):
        raise busy(File(str(task.output)))  # before another process starts in vain
    with tempfile.TemporaryDirectory(prefix="labkit-") as name:
        folder = File(name)
        output = task.output or str(folder / "result.state.nc")
        job = folder / "task.json"
        job.write_text(json.dumps(to_job(dataclasses.replace(task, output=output), folder)))
        kind.elsewhere(str(job), task.threads, progress)
        if not done_file(job).exists():
            raise PhysicsError(
                f"{task.engine} ended without an error, but did nothing: is `{task.engine}` on the PATH really it?"
            )
        return None if isinstance(task, (RunTask, ProbesTask)) else read_state(output)


def done_file(job: os.PathLike[str] | str) -> File:
    """Path of the file that a YADE process creates after it has carried out the task in the file `job`."""
    return File(f"{job}.done")


def to_job(task: Task, folder: File) -> dict[str, Any]:
    """Return a task as JSON, with the extension files that it needs."""
    names = ("engine", "threads", "precision", "output", "history")
    common = {name: getattr(task, name) for name in names}
    return {"kind": task.kind, "common": common, "values": task.values(folder), "use": _extensions(task)}


def from_job(job: Mapping[str, Any]) -> Task:
    """Build the task from the result of `to_job`, and load its extension files."""
    for file in job["use"]:
        use(file)
    return KINDS[job["kind"]].from_values(job["values"], job["common"])


def _paths(task: Task) -> tuple[Path, ...]:
    """The loading paths of a task."""
    if isinstance(task, RunTask):
        return (task.path,)
    return task.paths if isinstance(task, ProbesTask) else ()


def _extensions(task: Task) -> list[str]:
    """List the files that define the task's extensions."""
    needed: list[Any] = [ENGINES[task.engine], type(task.scene.contact_law)]
    needed += [statistic.function for statistic in recorded()]
    needed += [type(path) for path in _paths(task)]
    files = [file_of(one) for one in needed if not is_labkits(one)]
    if None in files or any("ipython" in str(file).lower() for file in files):
        raise InputError(
            "YADE cannot see a path, law or statistic defined in a notebook: define it in a file and load that with "
            "labkit.use"
        )
    return list(dict.fromkeys([*used(), *(file for file in files if file)]))
