"""Main Python interface: specimens, consolidation and tests, on any engine.

    scene = labkit.Scene(friction=0.5)
    state = labkit.make_specimen(labkit.Recipe(void_ratio=0.67, grains=1000), scene)
    run = labkit.run(state, labkit.paths.ConstantMeanStress(pressure=0.3e6, strain=0.05))

Without a file the result stays in memory.
"""

from __future__ import annotations

import dataclasses
import inspect
import os
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path as File
from typing import Any, TypedDict, Unpack

from labkit.engines import Device, device_of
from labkit.engines.base import Progress, silent
from labkit.errors import InputError, PhysicsError, instead_of, require_file_name, require_type
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.valid import require_state
from labkit.io.files import require_writable
from labkit.io.progress import reporter
from labkit.parameters import parameters_of, warn_of_doubt
from labkit.paths.path import Path
from labkit.paths.registry import make_path
from labkit.paths.standard import Consolidation
from labkit.records.limits import exceeded_by, require_pressure, size_warning, width_warning
from labkit.records.schedule import Options
from labkit.runs.read.run import Run
from labkit.runs.run.tasks import ConsolidationTask, RunTask, SpecimenTask, execute, load_task
from labkit.servo.correction import Servo
from labkit.specimens.recipe import Recipe


def make_specimen(
    recipe: Recipe,
    scene: Scene | None = None,
    engine: str | Device = "fused",
    threads: int = 1,
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
    **hardware: Unpack[Hardware],
) -> State:
    """Make a specimen at rest, and write its state file if `file` is given.

    Raises InputError for invalid values, PhysicsError if the specimen does not come to rest.

    Args:
        recipe: How to make the specimen.
        scene: The scene (default: labkit.Scene(), Table 1 of the paper).
        engine: Name of the engine, or labkit.Fused, Yade or Lammps with threads, ranks and precision.
        threads: Number of threads, if the engine is given by name.
        file: State file to write.
        progress: True to show the progress, or a function of the completed fraction and a text.
        hardware: If the engine is given by name: `precision`, "double" or "mixed", which is faster, and `ranks`, the
            number of MPI ranks.
    """
    require_type(recipe, Recipe, "recipe", "labkit.Recipe(void_ratio=0.67)")
    require_type(scene or Scene(), Scene, "scene", "labkit.Scene()")
    require_known(make_specimen, hardware, Hardware)
    device = device_of(engine, threads, **hardware)
    task = SpecimenTask(recipe=recipe, material=scene or Scene(), device=device, output=_output(file))
    warn(size_warning(task.scene))
    state = execute(task, progress_function(progress, "specimen"))
    for limit in exceeded_by(state):
        warn(f"{limit} in the specimen: give a larger void ratio")
    warn(width_warning(state))
    return state


def consolidate(
    state: State,
    pressure: float | str,
    engine: str | Device = "fused",
    threads: int = 1,
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
    cell: str | None = None,
    **hardware: Unpack[Hardware],
) -> State:
    """Consolidate a specimen to an isotropic stress, and write its state file if `file` is given.

    `pressure` is in Pa, or text with a unit. With a free `cell` all six stresses reach their targets, because the cell
    also shears; with a "fixed" one its angles and the shear stresses stay. By default it is as in the recipe of the
    specimen. The other arguments are as for make_specimen. Raises InputError for invalid values, PhysicsError if the
    pressure is not reached.
    """
    require_state(state)
    path = make_path("cr", {"pressure": pressure})
    warn_of_doubt(parameters_of(Consolidation)["pressure"].doubt(pressure))
    reached = path.start_pressure()
    if reached is None:
        raise InputError("is missing", field="pressure", allowed="the stress to reach, e.g. 0.5e6 or '500 kPa'")
    require_pressure(path, state.scene)
    require_known(consolidate, hardware, Hardware)
    device = device_of(engine, threads, **hardware)
    cell = None if cell is None else parameters_of(Consolidation)["cell"].read(cell)
    task = ConsolidationTask(state=state, pressure=reached, cell=cell, device=device, output=_output(file))
    return execute(task, progress_function(progress, "consolidation"))


def run(
    state: State,
    path: Path,
    engine: str | Device = "fused",
    file: str | os.PathLike[str] | None = None,
    threads: int = 1,
    progress: bool | Progress = True,
    precision: str = "double",
    ranks: int | None = None,
    **recording: Unpack[OptionsFields],
) -> Run:
    """Load a specimen along a path; returns the Run.

    If the path holds a stress, the specimen is first consolidated to that stress where needed. The state of an earlier
    run, such as `earlier.state`, continues unchanged, in motion; `earlier.state.at_rest()` is an ordinary specimen.
    If `file` is a run file with an unfinished run of the same test, that run is resumed. Without a file the Run is kept
    in memory. The other arguments are as for make_specimen; `recording` is `options`, labkit.Options, or fields of it
    (record_strain, snapshots, save_every, ...), which override those of `options`.
    Raises InputError; PhysicsError, with the records so far in its attribute `run`, if the simulation fails or a held
    stress cannot reach its target; and Interrupted, with a checkpoint in the file, after Ctrl-C or SIGTERM.
    """
    require_test(state, path)
    if file is not None:
        require_file_name(file, "file='r.run.nc'")
    options = recording_options(run, recording)
    device = device_of(engine, threads, precision, ranks)
    task = load_task(state, path, device=device, output=None if file is None else str(file), options=options)
    warn(task.warning)
    if file is not None:
        require_writable(file, "run")
    try:
        execute(task, progress_function(progress, task.path.name))
    except PhysicsError as failure:
        if is_begun(task):
            failure.run = result_of(task)
            if file is None:
                failure.args = (f"{failure}; the records up to that point are in the attribute `run` of this error",)
        raise
    return result_of(task)


def is_begun(task: RunTask) -> bool:
    """True if the records of a run, up to a checkpoint, are in its file or in memory."""
    return task.memory.state is not None if task.output is None else File(task.output).exists()


def result_of(task: RunTask) -> Run:
    """Return the Run of a task that has begun."""
    if task.output is not None:
        return Run.open(task.output)
    from labkit.runs.read.dataset import dataset_in_memory  # imports xarray

    return Run(dataset_in_memory(task.memory), last=task.memory.state)


class Hardware(TypedDict, total=False):
    """Arguments of a function that say on what an engine, given by name, computes."""

    precision: str
    ranks: int | None


class OptionsFields(TypedDict, total=False):
    """Arguments of a run that say what it records: Options, and fields of Options, which override them."""

    options: Options | None
    record_strain: float | str | None
    snapshots: int | str
    save_every: int | str | None
    stop_when: str | None
    inertial_number: float | str | None
    servo: Servo
    guarded: bool


def recording_options(function: Callable[..., object], recording: OptionsFields) -> Options:
    """Return the Options from the keyword arguments of `function`. Raises InputError for unknown arguments."""
    require_known(function, recording, OptionsFields)
    fields: dict[str, Any] = {**recording}
    return dataclasses.replace(fields.pop("options", None) or Options(), **fields)


def require_known(function: Callable[..., object], given: Iterable[str], fields: type) -> None:
    """Raise InputError for an argument that `function` does not have; its last parameter stands for `fields`."""
    for name in given:
        if name not in fields.__annotations__:
            *own, _ = inspect.signature(function).parameters
            problem = f"is not an argument of labkit.{function.__name__}"
            raise InputError(problem, field=name, allowed=instead_of([*own, *fields.__annotations__], name))


def require_test(state: State, path: Path) -> None:
    """Raise InputError if arguments of a function are not a specimen and a path."""
    require_state(state)
    require_type(path, Path, "path", "labkit.paths.ConstantVolume()")


def warn(likely: str | None) -> None:
    """Issue the warning, if any, at the caller's line."""
    if likely is not None:
        warnings.warn(likely, stacklevel=3)


def _output(file: str | os.PathLike[str] | None) -> str | None:
    if file is None:
        return None
    require_file_name(file, "file='s.state.nc'")
    require_writable(file, "state")
    return str(file)


def progress_function(progress: bool | Progress, title: str) -> Progress:
    """Return the progress function: for True, one that reports with a title."""
    if callable(progress):
        return progress
    return reporter(title) if progress else silent
