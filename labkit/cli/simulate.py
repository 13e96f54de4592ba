"""`labkit specimen`, `consolidate`, `bond` and `run`: carry out a task and report the result."""

from __future__ import annotations

import os
import sys
from pathlib import Path as File
from typing import Annotated, Literal, NamedTuple

from labkit.cli import arguments
from labkit.cli.arguments import History, Instance, Made, Option, ParameterTexts, PathOptions, Texts, Working
from labkit.cli.outputs import consolidated_name, run_name, specimen_name, tell_replaced
from labkit.cli.registry import command
from labkit.engines.base import Progress
from labkit.engines.device import Device
from labkit.errors import InputError
from labkit.grains.bonds import bond
from labkit.grains.scene import MADE_WITH, Scene
from labkit.grains.state import State
from labkit.grains.state_file import read_state, write_state
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind, open_netcdf
from labkit.io.progress import reporter
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import largest_deviation, mean_stress
from labkit.parameters import Values, parameters_of
from labkit.paths.path import Path
from labkit.paths.rates import default_rate
from labkit.paths.registry import PATHS, make_path
from labkit.paths.standard import Consolidation
from labkit.records.limits import exceeded_by, exceeded_in, require_pressure, size_warning, width_warning
from labkit.records.schedule import Options
from labkit.runs.read.endings import how_it_ended, void_ratio_at_start
from labkit.runs.run.tasks import ConsolidationTask, RunTask, SpecimenTask, Task, execute, load_task
from labkit.specimens.recipe import Recipe
from labkit.specimens.settings import SETTINGS
from labkit.specimens.specimen import specimen_summary

MATERIAL = "material, contact law and time step"
ANISOTROPIC = 0.005  # deviation from an isotropic stress, relative to its pressure, above which a command says so
NAMED = "(default: a name built from the parameters)"
Material = Annotated[
    Texts, ParameterTexts(Scene, MATERIAL, "By default, those of the specimen.", leave_out=MADE_WITH, unset=True)
]


class FromFile(NamedTuple):
    """A state file, or a run file and the number of a snapshot."""

    file: str | None
    snapshot: int | None

    def read(self) -> tuple[str, State]:
        """Return the name of the file and the State in it. Raises InputError if it cannot be read."""
        file = arguments.require(self.file, "specimen", "a state file")
        return file, read_state(file, snapshot=self.snapshot)


def source_of(
    specimen: Annotated[str | None, Option(arguments.FROM)] = None, *, from_snapshot: arguments.FromSnapshot = None
) -> FromFile:
    """Return the file of a specimen, without reading it."""
    return FromFile(specimen, from_snapshot)


def working_of(*, settings: arguments.Preset = None, computation: Working) -> tuple[str | None, Device]:
    """Return the preset and the engine."""
    return settings, computation


def specimen_task(
    *,
    recipe: Annotated[Texts, ParameterTexts(Recipe, "specimen")],
    material: Annotated[Texts, ParameterTexts(Scene, MATERIAL)],
    settings: arguments.Preset = None,
    computation: Working,
    output: Annotated[str | None, Option(f"state file to write {NAMED}", "FILE")] = None,
    history: History,
) -> SpecimenTask:
    """The task that the options describe. Raises InputError for invalid input, before work begins."""
    if recipe.get("pressure") is None:
        arguments.require(recipe.get("void_ratio"), "void_ratio", "one, e.g. 0.67")
    chosen = SETTINGS[settings or "standard"]
    size = {**recipe}
    if "side" not in size and "grains" not in size and chosen.grains is not None:
        size["grains"] = chosen.grains
    scene = Scene(**{"time_step_factor": chosen.time_step_factor, **material})
    made = Recipe(**size)
    made.side_of(scene)
    output = output or specimen_name(made, scene)
    require_writable(output, "state")
    return SpecimenTask(recipe=made, material=scene, output=output, history=history, device=computation)


@command("specimen")
def specimen_command(*, task: Annotated[SpecimenTask, Made(specimen_task)]) -> None:
    """Makes a periodic specimen at a given void ratio: grains are inserted at random and come to rest in two steps.

    Writes a state file.

    Example:
        labkit specimen --void-ratio 0.67 --grains 4000 -o s.state.nc
    """
    if File(str(task.output)).exists():
        if task.has_made(read_state(str(task.output))):
            print(f"{task.output}: already holds this specimen, nothing to do")
            return
        print(f"{task.output}: holds another specimen, which will be replaced", flush=True)
    state = execute(task, announcing(task, "specimen"))
    print(f"{task.output}: {one_line(state)}, {off_isotropic(state)}")
    for limit in (*exceeded_by(state), width_warning(state)):
        if limit is not None:
            print(f"{task.output}: {limit}")


def consolidation_task(
    *,
    specimen: Annotated[FromFile, Made(source_of)],
    pressure: Annotated[str | None, Option("isotropic pressure to reach, e.g. 500kPa; a number is in Pa")] = None,
    cell: Annotated[Literal["free", "fixed"] | None, Option(parameters_of(Consolidation)["cell"].help)] = None,
    computation: Working,
    output: Annotated[
        str | None, Option("state file to write (default: a name built from the specimen and the pressure)", "FILE")
    ] = None,
    history: History,
) -> ConsolidationTask:
    """The task that the options describe. Raises InputError for invalid input, before work begins."""
    path = make_path("cr", {"pressure": arguments.require(pressure, "pressure", "one, e.g. 500kPa")})
    source, start = specimen.read()
    require_pressure(path, start.scene)
    wanted = path.start_pressure() or 0.0
    output = output or consolidated_name(source, wanted, cell)
    _require_another(output, source)
    return ConsolidationTask(
        state=start, source=source, pressure=wanted, cell=cell, output=output, history=history, device=computation
    )


@command("consolidate")
def consolidate_command(*, task: Annotated[ConsolidationTask, Made(consolidation_task)]) -> None:
    """Brings a specimen to an isotropic stress.

    The three normal stresses reach the pressure, and the cell shears until the shear stresses are zero.
    Writes the consolidated specimen as a state file. `labkit run` does this by itself if the path holds a stress.

    Example:
        labkit consolidate s.state.nc --pressure 500kPa
        labkit consolidate r.run.nc --pressure 500kPa      # the specimen at the end of a run
    """
    output = str(task.output)
    state = execute(task, announcing(task, "consolidation"))
    print(f"{output}: {one_line(state)}, {off_isotropic(state, task.pressure)}")


def off_isotropic(state: State, pressure: float | None = None) -> str:
    """Say which stress is farthest from the isotropic stress `pressure`, Pa, by default from the mean stress."""
    stress = love_stress(state.snapshot())
    target = float(mean_stress(stress)) if pressure is None else pressure
    name, deviation = largest_deviation(stress, target)
    share = deviation / abs(target) if target else 0.0
    advice = "; --cell free makes the stress isotropic" if share > ANISOTROPIC else ""
    return f"deviation from the {'mean stress' if pressure is None else 'pressure'} {share:.2%} (sigma_{name}){advice}"


@command("bond")
def bond_command(
    *,
    specimen: Annotated[FromFile, Made(source_of)],
    material: Material,
    output: Annotated[str, Option("state file to write", "FILE")] = "bonded.state.nc",
) -> None:
    """Bonds all contacts of a specimen, with the contact law `bonded`.

    Writes a state file. The bonds carry no force at first; a bond that reaches its strength breaks permanently.

    Example:
        labkit bond s.state.nc --bond-strength 2MPa --bond-shear-strength 2MPa -o b.state.nc
    """
    source, state = specimen.read()
    _require_another(output, source)
    bonded = bond(state, state.scene.replace(**{"law": "bonded", **material}))
    write_state(output, bonded)
    print(f"{output}: {len(bonded.contact_grain)} bonds, {one_line(bonded)}")


def _require_another(output: str, source: str) -> None:
    """Raise InputError if the output is the source or cannot be written; print that an existing file is replaced."""
    if os.path.realpath(output) == os.path.realpath(source):
        raise InputError(f"{output} is the specimen itself, which would be overwritten: choose another -o")
    require_writable(output, "state")
    tell_replaced(output)


def run_task(
    path: Annotated[str | None, Option(f"loading path, one of {', '.join(PATHS)}, or a path file, FILE.yaml")] = None,
    *,
    specimen: Annotated[FromFile, Made(source_of)],
    loading: Annotated[Texts, PathOptions()],
    recording: Annotated[Options, Instance(Options, "recording")],
    material: Material,
    working: Annotated[tuple[str | None, Device], Made(working_of)],
    output: Annotated[str | None, Option(f"run file to write or resume {NAMED}", "FILE")] = None,
    history: History,
) -> RunTask:
    """The task that the options describe. Raises InputError for invalid input, before work begins."""
    word = arguments.require(path, "path", f"one of {', '.join(PATHS)}, or a path file")
    kind, written = named_path(word)
    source, state = specimen.read()
    settings, device = working
    factor = {} if settings is None else {"time_step_factor": SETTINGS[settings].time_step_factor}
    scene = state.scene.replace(**{**factor, **material})
    values = {**written, **loading}
    if settings is not None and "rate" not in values and recording.inertial_number is None:
        values["rate"] = default_rate(kind, scene) * SETTINGS[settings].rate_factor
    task = load_task(
        state.replace(scene=scene),
        make_path(kind.name, values),
        options=recording,
        source=source,
        output=output or run_name(word, source, kind, loading, material, settings),
        history=history,
        device=device,
    )
    require_writable(str(task.output), "run")
    return task


@command("run", epilog=arguments.list_of_paths)
def run_command(*, task: Annotated[RunTask, Made(run_task)]) -> None:
    """Loads a specimen along a path.

    Writes a run file with stresses, strains and statistics at each record, and the contacts at some of them. Repeat
    the same command to resume an interrupted run. Give a run file as the specimen to continue from its end, with its
    motion and stress.

    Examples:
        labkit run cv s.state.nc --strain 0.1 -o r.run.nc
        labkit run cp s.state.nc --pressure 300kPa --strain 5%
        labkit run cr r.run.nc --strain=-0.02
        labkit run cp --help                  # only the options of this path
    """
    file = str(task.output)
    finished = _attribute(file, "complete")
    execute(task, reporter(task.path.name) if finished else announcing(task, task.path.name))
    with open_netcdf(file, "run") as dataset:
        attributes = {name: dataset.getncattr(name) for name in dataset.ncattrs()}
        met = how_it_ended(attributes, dataset["coordination_number"][...])
        start = float(dataset["void_ratio_nominal"][0])
    if consolidated := void_ratio_at_start(Recipe.made_at(task.state.recipe), start):
        print(f"{file}: {consolidated}")
    print(f"{file}: " + ", ".join(("was already complete, nothing to do" if finished else "complete", *met)))
    if reason := attributes.get("ended_because", ""):
        print(f"{file}: ended: {reason}")
    for limit in exceeded_in(file):
        print(f"{file}: {limit}")


def named_path(word: str) -> tuple[type[Path], Values]:
    """Return the path class that `word` names, or the class and the parameters in the path file `word`."""
    if word.endswith(".nc"):
        raise InputError(
            f"{word} is no loading path: give the path first, then the specimen, as in labkit run cp {word}"
        )
    from labkit.paths.path_file import is_path_file, path_values

    return path_values(word) if is_path_file(word) else (PATHS.require(word), {})


def _attribute(file: str, name: str, verify: bool = True) -> int:
    """Return an attribute of a run file; 0 if the file does not exist or lacks the attribute."""
    if labkit_kind(file) != "run":
        return 0
    with open_netcdf(file, "run", verify=verify) as dataset:
        return int(getattr(dataset, name, 0))


def one_line(state: State) -> str:
    """Describe a specimen in one line."""
    return ", ".join(
        f"{name} {value if isinstance(value, int) else format(value, '.4g')} {unit}".rstrip()
        for name, (value, unit) in specimen_summary(state).items()
    )


def announcing(task: Task[object], title: str) -> Progress:
    """Return a progress function that first prints one line to standard error: engine, grains, steps, expected time.

    The line appears with the first progress report, so it is not printed if the input is invalid.
    """
    from labkit.runs.run.cost import announcement

    steps_done = _attribute(str(task.output), "steps", verify=False) if isinstance(task, RunTask) else 0
    reporters: list[Progress] = []

    def progress(fraction: float, text: str) -> None:
        if not reporters:
            print(f"{title}: {announcement(task, steps_done)}", file=sys.stderr, flush=True)
            warning = task.warning if isinstance(task, RunTask) else size_warning(task.scene)
            if warning:
                print(f"{title}: {warning}", file=sys.stderr, flush=True)
            reporters.append(reporter(title))
        reporters[0](fraction, text)

    return progress
