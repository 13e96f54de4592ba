"""`labkit specimen`, `consolidate`, `run` and `stratified`: turn options into a task for an engine, report the result.

The scripts in yade_scripts/ accept the same options and do the same inside YADE, where only numpy and netCDF4 are
available.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shlex
from collections.abc import Mapping
from pathlib import Path as File
from typing import Any

from labkit.cli.announce import announcing
from labkit.cli.arguments import (
    add_engine_options,
    add_parameters,
    add_path_parameters,
    add_settings_option,
    computation,
    given,
    require,
)
from labkit.cli.naming import consolidated_name, run_name, specimen_name
from labkit.cli.parser import Options as OptionGroup
from labkit.cli.parser import Parser, listed, summary_of
from labkit.cli.registry import command
from labkit.dem.consolidation import pressure_error
from labkit.dem.endings import met_conditions
from labkit.dem.limits import exceeded_by, exceeded_in, require_pressure
from labkit.dem.pace import require_one_rate
from labkit.dem.paths import PATHS, Path, make_path
from labkit.dem.scene import MADE_WITH, Scene
from labkit.dem.schedule import Options, Schedule
from labkit.dem.settings import Settings, settings
from labkit.dem.specimen import Recipe, summary
from labkit.dem.state import State, read_state
from labkit.dem.stratified import Layer
from labkit.engines import require_engine
from labkit.engines.tasks import ConsolidationTask, LayerTask, RunTask, SpecimenTask, Task, execute
from labkit.errors import InputError
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind, open_netcdf
from labkit.io.progress import reporter
from labkit.micro.stress import love_stress, mean_stress
from labkit.parameters import parameters_of, restored


def history_of(argv: list[str]) -> str:
    """The command line, for the history of a file."""
    return shlex.join(["labkit", *argv])


def specimen_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit specimen`; their names are also the columns of a yade-batch table."""
    add_parameters(parser.add_argument_group("specimen"), Recipe)
    add_parameters(parser.add_argument_group("material, contact law and time step"), Scene)
    _add_computation(parser)
    _add_output(parser, "state file to write (default: a name built from the parameters)")


def _add_computation(parser: argparse.ArgumentParser, settings: bool = True) -> None:
    group = parser.add_argument_group("computation")
    if settings:
        add_settings_option(group)
    add_engine_options(group)


def _add_output(parser: OptionGroup, help: str, default: str | None = None) -> None:
    parser.add_argument("-o", "--output", metavar="FILE", default=default, help=help)


def specimen_task(options: argparse.Namespace, history: str) -> SpecimenTask:
    """The task described by the options. Raises InputError for invalid input, before work begins."""
    require(options.void_ratio, "void_ratio", "one, e.g. 0.67")
    chosen = settings(options.settings or "standard")
    size, material = given(options, Recipe), given(options, Scene)
    if "side" not in size and "grains" not in size and chosen.grains is not None:
        size["grains"] = str(chosen.grains)
    scene = Scene(**{"time_step_factor": chosen.time_step_factor, **material})
    recipe = Recipe(**size)
    require_engine(options.engine, scene, options.precision)
    recipe.side_of(scene)
    output = options.output or specimen_name(recipe, scene)
    require_writable(output, "state")
    return SpecimenTask(recipe=recipe, material=scene, output=output, history=history, **computation(options))


@command("specimen", specimen_options)
def do_specimen(options: argparse.Namespace, argv: list[str]) -> None:
    """Makes a specimen and writes its state file, unless the file already holds exactly that specimen."""
    specimen(options, history_of(argv), announced=True)


def specimen(options: argparse.Namespace, history: str, announced: bool = False) -> None:
    """Makes a specimen, also inside YADE.

    history: command line to store as the history of the file; announced: whether to print the expected time.
    """
    task = specimen_task(options, history)
    if File(str(task.output)).exists():
        if _holds(read_state(str(task.output)), task):
            print(f"{task.output}: already holds this specimen, nothing to do")
            return
        print(f"{task.output}: holds another specimen, which will be replaced", flush=True)
    state = _done(task, "specimen", announced)
    print(f"{task.output}: {described(state)}")
    for limit in exceeded_by(state):
        print(f"{task.output}: {limit}")


def _holds(state: State, task: SpecimenTask) -> bool:
    """True if a state is the specimen of the task. Version 0.1.0 stored the side, not the number of grains."""
    try:
        recipe = restored(Recipe, json.loads(state.recipe))
        size = dataclasses.replace(recipe, side=recipe.side_of(state.scene), grains=None)
    except (TypeError, ValueError):  # a layer, or imported grains
        return False
    wanted = dataclasses.replace(task.recipe, side=task.recipe.side_of(task.scene), grains=None)
    made = size, state.scene, state.engine, state.precision
    return made == (wanted, task.scene, task.engine, task.precision)


def consolidation_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit consolidate`."""
    parser.add_argument("specimen", metavar="SPECIMEN", nargs="?", help="state file to start from")
    parser.add_argument(
        "--pressure", metavar="PRESSURE", help="isotropic pressure to reach, e.g. 500kPa; a number is in Pa"
    )
    _add_computation(parser, settings=False)
    _add_output(parser, "state file to write (default: a name built from the specimen and the pressure)")


def consolidation_task(options: argparse.Namespace, history: str) -> ConsolidationTask:
    """The task described by the options. Raises InputError for invalid input."""
    require(options.pressure, "pressure", "one, e.g. 500kPa")
    path = make_path("cr", {"pressure": options.pressure})
    state = read_state(require(options.specimen, "specimen", "a state file"))
    require_engine(options.engine, state.scene, options.precision)
    require_pressure(path, state.scene)
    pressure = path.start_pressure() or 0.0
    output = options.output or consolidated_name(options.specimen, pressure)
    if File(output).resolve() == File(options.specimen).resolve():
        raise InputError(f"{output} is the specimen itself, which would be overwritten: choose another -o")
    require_writable(output, "state")
    return ConsolidationTask(
        state=state,
        source=options.specimen,
        pressure=pressure,
        output=output,
        history=history,
        **computation(options),
    )


@command("consolidate", consolidation_options)
def do_consolidate(options: argparse.Namespace, argv: list[str]) -> None:
    """Consolidates a specimen to a pressure and writes its state file."""
    consolidation(options, history_of(argv), announced=True)


def consolidation(options: argparse.Namespace, history: str, announced: bool = False) -> None:
    """Consolidates a specimen, also inside YADE.

    history: command line to store as the history of the file; announced: whether to print the expected time.
    """
    task = consolidation_task(options, history)
    state = _done(task, "consolidation", announced)
    error = pressure_error(state.snapshot(), task.pressure)
    print(f"{task.output}: {described(state)}, deviation from the pressure {error:.2%}")


def run_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit run`; their names are also the columns of a yade-batch table.

    If the command line names a path, the help is limited to the parameters of that path.
    """
    words = parser.command_line if isinstance(parser, Parser) else ()
    named = [PATHS[word] for word in words if word in PATHS][:1] if {"-h", "--help"} & set(words) else []
    kinds = named or list(PATHS.values())
    parser.add_argument(
        "path", metavar="PATH", nargs="?", help=f"loading path, one of {', '.join(PATHS)}, or a path file, FILE.yaml"
    )
    parser.add_argument("specimen", metavar="SPECIMEN", nargs="?", help="state file to start from")
    add_path_parameters(parser.add_argument_group("loading path"), PATHS.values(), shown=kinds)
    add_parameters(parser.add_argument_group("recording"), Options)
    material = parser.add_argument_group("material, contact law and time step", "By default, those of the specimen.")
    add_parameters(material, Scene, leave_out=MADE_WITH, unset=True)
    _add_computation(parser)
    _add_output(parser, "run file to write or resume (default: a name built from the parameters)")
    parser.epilog = listed("loading path", {kind.name: summary_of(kind) for kind in kinds})


def run_task(options: argparse.Namespace, history: str) -> RunTask:
    """The task described by the options. Raises InputError for invalid input."""
    kind, written = named_path(require(options.path, "path", f"one of {', '.join(PATHS)}, or a path file"))
    state = read_state(require(options.specimen, "specimen", "a state file"))
    chosen = settings(options.settings) if options.settings is not None else None
    state = state.replace(scene=run_scene(options, state.scene, chosen))
    require_engine(options.engine, state.scene, options.precision)
    path = run_path(options, kind, state.scene, chosen, written)
    path = path.starting_at(float(mean_stress(love_stress(state.snapshot()))))
    require_pressure(path, state.scene)
    recording = Options(**given(options, Options))
    require_one_rate(path, recording)
    Schedule.of(path.for_scene(state.scene), state.scene.time_step, state.number_of_grains, recording)
    output = options.output or run_name(options, kind)
    require_writable(output, "run")
    return RunTask(
        state=state,
        source=options.specimen,
        path=path,
        options=recording,
        output=output,
        history=history,
        **computation(options),
    )


def run_scene(options: argparse.Namespace, scene: Scene, chosen: Settings | None) -> Scene:
    """The scene of a specimen with the changes given by the options."""
    changes: dict[str, Any] = {} if chosen is None else {"time_step_factor": chosen.time_step_factor}
    return dataclasses.replace(scene, **{**changes, **given(options, Scene)})


def named_path(word: str) -> tuple[type[Path], dict[str, Any]]:
    """The path of that name, or the path of a path file and the parameters that the file gives. Raises InputError."""
    from labkit.campaign.path_file import is_path_file, path_values

    return path_values(word) if is_path_file(word) else (PATHS.require(word), {})


def run_path(
    options: argparse.Namespace,
    kind: type[Path],
    scene: Scene,
    chosen: Settings | None,
    written: Mapping[str, Any] | None = None,
) -> Path:
    """The path described by the options; the settings scale its default rate for the grains of the scene.

    written: parameters from a path file, which those of the command line replace.
    """
    known = {name for one in PATHS.values() for name in parameters_of(one)}
    given_here = {name: getattr(options, name, None) for name in known}
    values = {**(written or {}), **{name: value for name, value in given_here.items() if value is not None}}
    if chosen is not None and values.get("rate") is None and options.inertial_number is None:
        values["rate"] = kind.default_rate(scene) * chosen.rate_factor
    return make_path(kind.name, values)


@command("run", run_options)
def do_run(options: argparse.Namespace, argv: list[str]) -> None:
    """Loads a specimen along a path and writes the run file, unless the file already holds the finished run."""
    run(options, history_of(argv), announced=True)


def run(options: argparse.Namespace, history: str, announced: bool = False) -> None:
    """Loads a specimen along a path, also inside YADE.

    history: command line to store as the history of the file; announced: whether to print the expected time.
    """
    task = run_task(options, history)
    output = str(task.output)
    finished = _finished(output)
    execute(task, reporter(task.path.name) if finished or not announced else announcing(task, task.path.name))
    with open_netcdf(output, "run") as dataset:
        reason = getattr(dataset, "ended_because", "")
        records = {name: each[...] for name, each in dataset.variables.items() if each.dimensions[:1] == ("time",)}
    met = met_conditions(task.path, task.options.stop_when, records)
    print(f"{output}: " + ", ".join(("was already complete, nothing to do" if finished else "complete", *met)))
    if reason:
        print(f"{output}: ended: {reason}")
    for limit in exceeded_in(output):
        print(f"{output}: {limit}")


def _finished(file: str) -> bool:
    """True if a file holds a complete run."""
    if not (File(file).exists() and labkit_kind(file) == "run"):
        return False
    with open_netcdf(file, "run") as dataset:
        return bool(dataset.complete)


def layer_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit stratified`; their names are also the columns of a yade-batch table."""
    add_parameters(parser.add_argument_group("layer"), Layer)
    _add_computation(parser, settings=False)
    _add_output(parser, "state file to write (default: stratified.state.nc)", "stratified.state.nc")


def layer_task(options: argparse.Namespace, history: str) -> LayerTask:
    """The task described by the options. Raises InputError for invalid input."""
    layer = Layer(**given(options, Layer))
    require_writable(options.output, "state")
    return LayerTask(layer=layer, output=options.output, history=history, **computation(options))


def stratified(options: argparse.Namespace, history: str) -> None:
    """Makes the layer of Fig. 3 and writes its state file, unless the file already holds exactly that layer."""
    task = layer_task(options, history)
    if File(options.output).exists() and read_state(options.output).recipe == task.layer.to_json():
        return
    state = _done(task, "layer")
    print(f"{options.output}: {state.number_of_grains} grains")


def _done(task: Task, title: str, announced: bool = False) -> State:
    state = execute(task, announcing(task, title) if announced else reporter(title))
    if state is None:
        raise InputError(f"a {task.kind} produces no state")
    return state


def described(state: State) -> str:
    """One-line summary of a specimen."""
    texts = {
        name: f"{value}" if isinstance(value, int) else f"{value:.4g}" for name, (value, _) in summary(state).items()
    }
    return ", ".join(f"{name} {texts[name]} {unit}".rstrip() for name, (_, unit) in summary(state).items())
