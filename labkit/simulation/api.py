"""Main Python interface: specimens, consolidation and tests, on any engine.

    scene = labkit.Scene(friction=0.5)
    state = labkit.make_specimen(labkit.Recipe(void_ratio=0.67, grains=1000), scene)
    run = labkit.run(state, labkit.paths.ConstantMeanStress(pressure=0.3e6, strain=0.05))

Without a file the result stays in memory.
"""

from __future__ import annotations

import os
from pathlib import Path as File

from labkit.engines import Device, device_of
from labkit.engines.base import Progress, silent
from labkit.errors import PhysicsError, require_file_name, warn
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.parameters import parameters_of, warn_of_doubt
from labkit.paths.path import Path
from labkit.paths.standard import Consolidation
from labkit.process.progress import reporter
from labkit.records.schedule import Options
from labkit.results.run import Run
from labkit.servo.correction import STANDARD, Servo
from labkit.simulation.tasks import ConsolidationTask, RunTask, SpecimenTask, execute
from labkit.specimens.recipe import Recipe


def make_specimen(
    recipe: Recipe,
    scene: Scene | None = None,
    *,
    engine: str | Device = "fused",
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
) -> State:
    """Make a specimen at rest, and write its state file if `file` is given.

    Raises InputError for invalid values, PhysicsError if the specimen does not come to rest.

    Args:
        recipe: How to make the specimen.
        scene: The scene (default: labkit.Scene(), Table 1 of the paper).
        engine: labkit.Fused, Yade or Lammps with threads, precision or ranks, or the name of an engine.
        file: State file to write.
        progress: True to show the progress, or a function of the completed fraction and a text.
    """
    material = Scene() if scene is None else scene
    task = SpecimenTask(recipe=recipe, material=material, device=device_of(engine), output=_name(file))
    warn(task.warning)
    state = execute(task, progress_function(progress, task.title))
    warn(*task.findings(state))
    return state


def consolidate(
    state: State,
    pressure: float | str,
    *,
    engine: str | Device = "fused",
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
    cell: str | None = None,
) -> State:
    """Consolidate a specimen to an isotropic stress, and write its state file if `file` is given.

    `pressure` is in Pa, or text with a unit. With a free `cell` all six stresses reach their targets, because the cell
    also shears; with a "fixed" one its angles and the shear stresses stay. By default it is as in the recipe of the
    specimen. The other arguments are as for make_specimen. Raises InputError for invalid values, PhysicsError if the
    pressure is not reached.
    """
    warn_of_doubt(parameters_of(Consolidation)["pressure"].doubt(pressure))
    task = ConsolidationTask(state=state, pressure=pressure, cell=cell, device=device_of(engine), output=_name(file))
    warn(task.warning)
    return execute(task, progress_function(progress, task.title))


def run(
    state: State,
    path: Path,
    *,
    engine: str | Device = "fused",
    file: str | os.PathLike[str] | None = None,
    progress: bool | Progress = True,
    record_strain: float | str | None = None,
    snapshots: int | str = Options.snapshots,
    save_every: int | str | None = None,
    stop_when: str | None = None,
    inertial_number: float | str | None = None,
    servo: Servo = STANDARD,
    guarded: bool = True,
) -> Run:
    """Load a specimen along a path; returns the Run.

    If the path holds a stress, the specimen is first consolidated to that stress where needed. The state of an earlier
    run, such as `earlier.state`, continues unchanged, in motion; `earlier.state.at_rest()` is an ordinary specimen.
    If `file` is a run file with an unfinished run of the same test, that run is resumed. Without a file the Run is kept
    in memory. The other arguments are as for make_specimen; labkit.Options describes
    record_strain to guarded.
    Raises InputError; PhysicsError, with the records so far in its attribute `run`, if the simulation fails or a held
    stress cannot reach its target; and Interrupted, with a checkpoint in the file, after Ctrl-C or SIGTERM.
    """
    options = Options(record_strain, snapshots, save_every, stop_when, inertial_number, servo, guarded)
    task = RunTask(state=state, path=path, options=options, device=device_of(engine), output=_name(file, "r.run.nc"))
    warn(task.warning)
    try:
        execute(task, progress_function(progress, task.title))
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
    from labkit.results.dataset import dataset_in_memory  # imports xarray

    return Run(dataset_in_memory(task.memory), last=task.memory.state)


def _name(file: str | os.PathLike[str] | None, example: str = "s.state.nc") -> str | None:
    """Return the name of a file to write, if any. Raises InputError, with an example, for anything else."""
    if file is None:
        return None
    require_file_name(file, f"file='{example}'")
    return str(file)


def progress_function(progress: bool | Progress, title: str) -> Progress:
    """Return the progress function: for True, one that reports with a title."""
    if callable(progress):
        return progress
    return reporter(title) if progress else silent
