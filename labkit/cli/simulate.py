"""`labkit specimen`, `consolidate`, `bond` and `run`: carry out a task and report the result."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from labkit.cli import arguments
from labkit.cli.arguments import History, Instance, Made, Option, ParameterTexts, PathOptions, Texts, Working
from labkit.cli.outputs import consolidated_name, run_name, specimen_name, tell_replaced
from labkit.cli.registry import command
from labkit.engines.device import Device
from labkit.errors import InputError
from labkit.grains.scene import MADE_WITH, Scene
from labkit.grains.state import State
from labkit.grains.state_file import read_state
from labkit.parameters import Values, parameters_of
from labkit.paths.path import Path
from labkit.paths.rates import default_rate
from labkit.paths.registry import PATHS, make_path
from labkit.paths.standard import Consolidation
from labkit.records.schedule import Options
from labkit.simulation.reports import execute_and_report, one_line
from labkit.simulation.tasks import BondTask, ConsolidationTask, RunTask, SpecimenTask
from labkit.specimens.recipe import SETTINGS, Recipe

MATERIAL = "material, contact law and time step"
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
    specimen = Recipe(**size)
    output = output or specimen_name(specimen, scene)
    return SpecimenTask(recipe=specimen, material=scene, output=output, history=history, device=computation)


@command("specimen")
def specimen_command(*, task: Annotated[SpecimenTask, Made(specimen_task)]) -> None:
    """Makes a periodic specimen at a given void ratio: grains are inserted at random and come to rest in two steps.

    Writes a state file.

    Example:
        labkit specimen --void-ratio 0.67 --grains 4000 -o s.state.nc
    """
    execute_and_report(task)


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
    parameter = parameters_of(Consolidation)["pressure"]
    wanted = parameter.read(parameter.require_unit(arguments.require(pressure, "pressure", "one, e.g. 500kPa")))
    source, start = specimen.read()
    output = output or consolidated_name(source, wanted, cell, specimen.snapshot)
    task = ConsolidationTask(
        state=start, source=source, pressure=wanted, cell=cell, output=output, history=history, device=computation
    )
    tell_replaced(output)
    return task


@command("consolidate")
def consolidate_command(*, task: Annotated[ConsolidationTask, Made(consolidation_task)]) -> None:
    """Brings a specimen to an isotropic stress.

    The three normal stresses reach the pressure, and the cell shears until the shear stresses are zero.
    Writes the consolidated specimen as a state file. `labkit run` does this by itself if the path holds a stress.

    Example:
        labkit consolidate s.state.nc --pressure 500kPa
        labkit consolidate r.run.nc --pressure 500kPa      # the specimen at the end of a run
    """
    execute_and_report(task)


@command("bond")
def bond_command(
    *,
    specimen: Annotated[FromFile, Made(source_of)],
    material: Material,
    output: Annotated[str, Option("state file to write", "FILE")] = "bonded.state.nc",
    history: History,
) -> None:
    """Bonds all contacts of a specimen, with the contact law `bonded`.

    Writes a state file. The bonds carry no force at first; a bond that reaches its strength breaks permanently.

    Example:
        labkit bond s.state.nc --bond-strength 2MPa --bond-shear-strength 2MPa -o b.state.nc
    """
    source, state = specimen.read()
    scene = state.scene.replace(**{"law": "bonded", **material})
    task = BondTask(state=state, bonded=scene, source=source, output=output, history=history)
    tell_replaced(output)
    bonded = task.do()
    print(f"{output}: {len(bonded.contact_grain)} bonds, {one_line(bonded)}")


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
    return RunTask(
        state=state.replace(scene=scene),
        path=make_path(kind.name, values),
        options=recording,
        source=source,
        output=output or run_name(word, source, kind, loading, material, settings, specimen.snapshot),
        history=history,
        device=device,
    )


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
    execute_and_report(task)


def named_path(word: str) -> tuple[type[Path], Values]:
    """Return the path class that `word` names, or what `path_values` reads from the path file `word`."""
    if word.endswith(".nc"):
        raise InputError(
            f"{word} is no loading path: give the path first, then the specimen, as in labkit run cp {word}"
        )
    from labkit.paths.path_file import is_path_file, path_values

    return path_values(word) if is_path_file(word) else (PATHS.require(word), {})
