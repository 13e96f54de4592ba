"""Tasks: specimens, consolidations and runs as values that any engine can execute.

Python, the command line and campaigns construct the same tasks. A task checks itself when it is constructed, and says
what it warns of, so that all three refuse and warn alike.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import json
from collections.abc import Generator
from pathlib import Path as File
from typing import ClassVar, Generic, TypeAlias, TypeVar

from labkit.engines.base import Engine, Progress, Request, silent
from labkit.engines.device import Device
from labkit.errors import InputError, require_type
from labkit.extensions import files_in_use
from labkit.files import arrays
from labkit.files.provenance import provenance_json
from labkit.files.writable import require_writable
from labkit.grains.bonds import bond
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.state_file import write_state
from labkit.grains.valid import require_state
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.paths.path import Path
from labkit.paths.rates import on_grains
from labkit.paths.standard import Consolidation
from labkit.process.blas import one_blas_thread
from labkit.process.interruption import only_writer
from labkit.records.limits import exceeded_by, rate_warning, require_pressure, size_warning, width_warning
from labkit.records.memory import RunInMemory
from labkit.records.schedule import Options, Schedule
from labkit.simulation.clock import require_one_rate
from labkit.simulation.simulation import default_pressure, lost_deviator, simulation
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

    Raises:
        InputError: If the task is impossible or its output cannot be written.
    """

    device: Device = dataclasses.field(default_factory=Device)
    output: str | None = None
    history: str = ""

    writes: ClassVar[str] = "state"  # kind of the output

    def __post_init__(self) -> None:
        """Check the output; a subclass also checks its own fields."""
        if self.output is not None:
            require_writable(self.output, self.writes, self.inputs)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Input files, for the provenance; none of them is overwritten."""
        return ()

    @property
    @abc.abstractmethod
    def scene(self) -> Scene:
        """Scene of the grains."""

    @property
    @abc.abstractmethod
    def title(self) -> str:
        """Name of the task in progress messages."""

    @property
    def warning(self) -> str | None:
        """What to tell the user before the task begins, if anything."""
        return size_warning(self.scene)

    @abc.abstractmethod
    def do(self, progress: Progress) -> Result:
        """Run the task in this process; return its result."""

    def with_origin(self, state: State) -> State:
        """Return the State with the history and provenance of this task."""
        history = "\n".join(line for line in (state.history, self.history) if line)
        inputs = (*self.inputs, *files_in_use())
        provenance = provenance_json(self.history or None, inputs, self.output, state.seed, self.title)
        return state.replace(history=history, provenance=provenance)

    def finish(self, state: State) -> State:
        """Return the State with its origin; write it to `output` if that is set."""
        state = self.with_origin(state)
        if self.output is not None:
            write_state(self.output, state)
        return state


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpecimenTask(Task[State]):
    """Make a specimen."""

    recipe: Recipe
    material: Scene

    title = "specimen"

    def __post_init__(self) -> None:
        """Check the recipe for the grains of the scene."""
        require_type(self.recipe, Recipe, "recipe", "labkit.Recipe(void_ratio=0.67)")
        require_type(self.material, Scene, "scene", "labkit.Scene()")
        self.recipe.side_of(self.material)
        super().__post_init__()

    @property
    def scene(self) -> Scene:
        return self.material

    def findings(self, state: State) -> tuple[str, ...]:
        """Return what is wrong with the specimen that was made: limits that it exceeds, and too narrow a cell."""
        limits = (f"{limit} in the specimen: give a larger void ratio" for limit in exceeded_by(state))
        return tuple(
            filter(None, (*limits, width_warning(state), self.recipe.missed(void_ratio_nominal(state.snapshot()))))
        )

    def has_made(self, state: State) -> bool:
        """True if a State is the specimen of this task, on any number of threads."""
        same = state.scene, state.engine, state.precision
        mine = self.material, self.device.name, self.device.precision
        task = json.loads(state.provenance or "{}").get("task", self.title)  # earlier versions do not say it
        return same == mine and Recipe.from_json(state.recipe) == self.recipe and task == self.title

    def do(self, progress: Progress) -> State:
        make = MAKERS[self.recipe.preparation]
        return self.finish(make(self.material, self.recipe, self.device, progress))


@dataclasses.dataclass(frozen=True, kw_only=True)
class StateTask(Task[Result]):
    """A task that starts from a State; `source` is the file of that State, if any."""

    state: State
    source: str | None = None

    def __post_init__(self) -> None:
        """Check the state."""
        require_state(self.state)
        super().__post_init__()

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

    pressure: float | str
    cell: str | None = None
    path: Consolidation = dataclasses.field(init=False)

    title = "consolidation"

    def __post_init__(self) -> None:
        """Make the path to the pressure, and check it for the grains of the state."""
        super().__post_init__()
        if self.pressure is None:
            raise InputError("is missing", field="pressure", allowed="the stress to reach, e.g. 0.5e6 or '500 kPa'")
        cell = Recipe.cell_of(self.state) if self.cell is None else self.cell
        object.__setattr__(self, "path", Consolidation(pressure=self.pressure, cell=cell))
        object.__setattr__(self, "pressure", self.path.held_pressure)
        require_pressure(self.path, self.scene)

    def do(self, progress: Progress) -> State:
        state = consolidation.bring_to(self.state, self.path, self.device, progress, interim_of(self.output))
        return self.finish(state)


@dataclasses.dataclass(frozen=True, kw_only=True)
class BondTask(StateTask[State]):
    """Bond the contacts of a specimen under the law of a new scene."""

    bonded: Scene

    title = "bonds"

    @property
    def scene(self) -> Scene:
        return self.bonded

    def do(self, progress: Progress = silent) -> State:
        return self.finish(bond(self.state, self.bonded))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunTask(StateTask[None]):
    """Load a specimen along a path and write the run file `output`, or resume that file if it is unfinished.

    Without an output the run is kept in `memory`.
    """

    path: Path
    options: Options = dataclasses.field(default_factory=Options)
    memory: RunInMemory = dataclasses.field(default_factory=RunInMemory)

    writes = "run"

    def __post_init__(self) -> None:
        """Resolve the rate and the pressure of the path for the specimen, and check that they fit."""
        super().__post_init__()
        if self.output is not None and self.output.endswith(arrays.ENDING):
            raise InputError(f"{self.output}: is no name for a run that is saved in steps: give one such as r.run.nc")
        require_type(self.path, Path, "path", "labkit.paths.ConstantVolume()")
        require_one_rate(self.path, self.options)
        path = self.path.starting_at(default_pressure(self.path, self.state))
        object.__setattr__(self, "path", on_grains(path, self.scene))
        require_pressure(self.path, self.scene)
        Schedule.of(self.path, self.scene.time_step, self.state.number_of_grains, self.options)

    @property
    def title(self) -> str:
        return self.path.name

    @property
    def warning(self) -> str | None:
        of_rate = rate_warning(self.path, self.state, self.options.inertial_number)
        return "; ".join(filter(None, (lost_deviator(self.path, self.state), of_rate))) or None

    def do(self, progress: Progress) -> None:
        self.device.drive(self.run(progress))

    def run(self, progress: Progress) -> Generator[Request, object, bool]:
        """Yield the requests of the task to an engine."""
        state = self.with_origin(self.state)
        output = self.memory if self.output is None else File(self.output)
        return (yield from simulation(state, self.path, output, self.device, self.options, progress))


AnyTask: TypeAlias = SpecimenTask | ConsolidationTask | RunTask


def require_possible(task: Task[object]) -> type[Engine]:
    """Return the engine class of a task. Raises InputError if it cannot execute the task on this computer."""
    task.device.require_scene(task.scene)
    of_recipe = isinstance(task, SpecimenTask) and task.recipe.shape != Recipe.shape
    task.device.require_grains(of_recipe or (isinstance(task, StateTask) and task.state.clumps is not None))
    kind = task.device.kind
    kind.abilities.require_computer()
    return kind


def execute(task: Task[Result], progress: Progress = silent) -> Result:
    """Execute a task; return its result. Raises InputError, PhysicsError or Interrupted."""
    require_possible(task)
    states = task.output is not None and not isinstance(task, RunTask)  # the recorder of a run locks its file
    with one_blas_thread(), only_writer(File(str(task.output))) if states else contextlib.nullcontext():
        return task.do(progress)
