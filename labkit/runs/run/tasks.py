"""Tasks: specimens, consolidations, rests and runs as values that any engine can execute."""

from __future__ import annotations

import abc
import contextlib
import dataclasses
from collections.abc import Generator
from pathlib import Path as File
from typing import Any, Generic, TypeVar

from labkit.engines.base import Engine, Progress, Request, silent
from labkit.engines.device import Device
from labkit.extensions import files_in_use
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.state_file import write_state
from labkit.io.blas import one_blas_thread
from labkit.io.interruption import only_writer
from labkit.io.provenance import provenance_json
from labkit.paths.path import Path
from labkit.paths.rates import on_grains
from labkit.paths.standard import Consolidation
from labkit.records.limits import rate_warning, require_pressure
from labkit.records.memory import RunInMemory
from labkit.records.schedule import Options, Schedule
from labkit.runs.run.pace import require_one_rate
from labkit.runs.run.simulation import default_pressure, simulation
from labkit.specimens import bisection, compression, consolidation, specimen
from labkit.specimens.consolidation import interim_of
from labkit.specimens.recipe import Recipe

Result = TypeVar("Result", covariant=True)
MAKERS = {
    "insertion": specimen.prepare_specimen,
    "compression": compression.compress_gas,
    "bisection": bisection.find_friction,
}


@dataclasses.dataclass(frozen=True)
class Task(abc.ABC, Generic[Result]):
    """A job for an engine; its result is a State, or None for a run.

    Args:
        device: Engine, with threads or ranks and precision.
        output: File to write.
        history: Command to record.
    """

    device: Device = dataclasses.field(default_factory=Device)
    output: str | None = None
    history: str = ""

    @property
    @abc.abstractmethod
    def scene(self) -> Scene:
        """Scene of the grains."""

    @abc.abstractmethod
    def do(self, progress: Progress) -> Result:
        """Run the task in this process; return its result."""

    def with_origin(self, state: State, inputs: tuple[str, ...]) -> State:
        """Return the State with the history and provenance of this task."""
        history = "\n".join(line for line in (state.history, self.history) if line)
        made = provenance_json(self.history or None, (*inputs, *files_in_use()), self.output, state.seed)
        return state.replace(history=history, provenance=made)

    def finish(self, state: State, inputs: tuple[str, ...] = ()) -> State:
        """Return the State with its origin; write it to `output` if that is set."""
        state = self.with_origin(state, inputs)
        if self.output is not None:
            write_state(self.output, state)
        return state


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpecimenTask(Task[State]):
    """Make a specimen."""

    recipe: Recipe
    material: Scene

    @property
    def scene(self) -> Scene:
        return self.material

    def has_made(self, state: State) -> bool:
        """True if a State is the specimen of this task, on any number of threads."""
        same = state.scene, state.engine, state.precision
        mine = self.material, self.device.name, self.device.precision
        return same == mine and Recipe.from_json(state.recipe) == self.recipe

    def do(self, progress: Progress) -> State:
        make = MAKERS[self.recipe.preparation]
        return self.finish(make(self.material, self.recipe, self.device, progress))


@dataclasses.dataclass(frozen=True, kw_only=True)
class StateTask(Task[Result]):
    """A task that starts from a State; `source` is the file of that State, if any."""

    state: State
    source: str | None = None

    @property
    def scene(self) -> Scene:
        return self.state.scene

    @property
    def inputs(self) -> tuple[str, ...]:
        """Input files, for the provenance."""
        return () if self.source is None else (self.source,)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConsolidationTask(StateTask[State]):
    """Consolidate a specimen to an isotropic pressure, Pa; `cell` is None to use that of its recipe."""

    pressure: float
    cell: str | None = None

    @property
    def path(self) -> Consolidation:
        """The path to the pressure."""
        return consolidation.path_to(self.pressure, self.cell or Recipe.cell_of(self.state))

    def do(self, progress: Progress) -> State:
        state = consolidation.bring_to(self.state, self.path, self.device, progress, interim_of(self.output))
        return self.finish(state, self.inputs)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunTask(StateTask[None]):
    """Load a specimen along a path and write the run file `output`, or resume that file if it is unfinished.

    Without an output the run is kept in `memory`.
    """

    path: Path
    options: Options = dataclasses.field(default_factory=Options)
    memory: RunInMemory = dataclasses.field(default_factory=RunInMemory)

    def __post_init__(self) -> None:
        """Resolve the rate of the path for the grains of the state."""
        object.__setattr__(self, "path", on_grains(self.path, self.scene))

    @property
    def warning(self) -> str | None:
        """A warning, if any, about the rate of the run."""
        return rate_warning(self.path, self.state, self.options.inertial_number)

    def do(self, progress: Progress) -> None:
        self.device.drive(self.run(progress))

    def run(self, progress: Progress) -> Generator[Request, object, bool]:
        """Yield the requests of the task to an engine."""
        require_pressure(self.path, self.scene)
        state = self.with_origin(self.state, self.inputs)
        output = self.memory if self.output is None else File(self.output)
        return (yield from simulation(state, self.path, output, self.device, self.options, progress))


def load_task(state: State, path: Path, *, options: Options, **common: Any) -> RunTask:
    """Return the task that loads a specimen along a path; `common`: other fields of the task. Raises InputError."""
    require_one_rate(path, options)
    task = RunTask(state=state, path=path.starting_at(default_pressure(path, state)), options=options, **common)
    require_pressure(task.path, state.scene)
    Schedule.of(task.path, state.scene.time_step, state.number_of_grains, options)  # raises InputError before the start
    return task


def require_possible(task: Task[object]) -> type[Engine]:
    """Return the engine class of a task. Raises InputError if it cannot execute the task on this computer."""
    task.device.require_scene(task.scene)
    of_recipe = isinstance(task, SpecimenTask) and task.recipe.shape != Recipe.shape
    task.device.require_grains(of_recipe or (isinstance(task, StateTask) and task.state.clumps is not None))
    kind = task.device.kind
    if isinstance(task, RunTask):
        task.device.require_path(task.path)
    kind.abilities.require_computer()
    return kind


def execute(task: Task[Result], progress: Progress = silent) -> Result:
    """Execute a task; return its result. Raises InputError, PhysicsError or Interrupted."""
    require_possible(task)
    states = task.output is not None and not isinstance(task, RunTask)  # the recorder of a run locks its file
    with one_blas_thread(), only_writer(File(str(task.output))) if states else contextlib.nullcontext():
        return task.do(progress)
