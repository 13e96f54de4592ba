"""`labkit specimen`, `consolidate`, `run` and `stratified`: from options to the task of an engine, and its report.

The scripts of yade_scripts/ take the same options and do the same inside YADE, where only numpy and netCDF4 are.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shlex
from pathlib import Path as File

from labkit.cli.arguments import (
    add_engine_options,
    add_parameters,
    add_path_parameters,
    add_settings_option,
    given,
    require,
)
from labkit.cli.registry import command
from labkit.dem.consolidation import pressure_error
from labkit.dem.limits import exceeded_by, exceeded_in, require_pressure
from labkit.dem.paths import PATHS, Consolidation, Path, make_path
from labkit.dem.scene import MADE_WITH, Scene
from labkit.dem.settings import Settings, settings
from labkit.dem.simulation import Options, Schedule
from labkit.dem.specimen import SIDE, Recipe, summary
from labkit.dem.state import State, read_state
from labkit.dem.stratified import Layer
from labkit.engines import require_engine
from labkit.engines.tasks import ConsolidationTask, LayerTask, RunTask, SpecimenTask, Task, execute
from labkit.errors import InputError, shown
from labkit.io.files import labkit_kind, open_netcdf, require_writable
from labkit.io.progress import reporter
from labkit.micro.stress import love_stress, mean_stress
from labkit.parameters import parameters_of, restored


def history_of(argv: list[str]) -> str:
    """The command as a person would type it again."""
    return shlex.join(["labkit", *argv])


def specimen_options(parser: argparse.ArgumentParser) -> None:
    """Options of a specimen; their names are also the columns of a yade-batch table."""
    add_parameters(parser, Recipe)
    add_parameters(parser, Scene)
    add_settings_option(parser)
    add_engine_options(parser)
    parser.add_argument("-o", "--output", help="state file to write (default: a name made of the parameters)")


def specimen_task(options: argparse.Namespace, history: str) -> SpecimenTask:
    """The task of the options. Raises InputError for anything that cannot work, before work begins."""
    require(options.void_ratio, "void_ratio", "e.g. 0.67")
    chosen = settings(options.settings or "standard")
    size, material = given(options, Recipe), given(options, Scene)
    if "side" not in size and "grains" not in size and chosen.grains is not None:
        size["grains"] = str(chosen.grains)
    scene = Scene(**{"time_step_factor": chosen.time_step_factor, **material})
    recipe = Recipe(**size)  # type: ignore[arg-type]
    require_engine(options.engine, scene)
    recipe.side_of(scene)
    output = options.output or specimen_name(recipe, scene)
    require_writable(output, "state")
    return SpecimenTask(
        recipe=recipe, material=scene, engine=options.engine, threads=options.threads, output=output, history=history
    )


SHORT = {
    "young_modulus": "E",
    "time_step_factor": "t",
    "friction": "mu",
    "rolling_friction": "mur",
    "strain": "e",
    "rate": "r",
    "reversals": "c",
}


def specimen_name(recipe: Recipe, scene: Scene) -> str:
    """A file name from the parameters; of the scene those that are not Table 1's."""
    size = f"n{recipe.grains}" if recipe.grains else f"l{SIDE if recipe.side is None else recipe.side:g}"
    words = [
        f"e{recipe.void_ratio:g}",
        f"f{recipe.step1_friction:g}",
        f"r{recipe.step1_rolling_friction:g}",
        size,
        f"s{recipe.seed}",
    ]
    for name in parameters_of(Scene):
        value = getattr(scene, name)
        if value != getattr(Scene, name):
            words.append(_word(name, value))
    return "_".join(words) + ".state.nc"


@command("specimen", specimen_options)
def do_specimen(options: argparse.Namespace, argv: list[str]) -> None:
    """Makes a specimen and writes its state file, unless the file is there and holds just that specimen."""
    specimen(options, history_of(argv))


def specimen(options: argparse.Namespace, history: str) -> None:
    """The same with a history of one's own, as inside YADE."""
    task = specimen_task(options, history)
    if File(str(task.output)).exists():
        if _holds(read_state(str(task.output)), task):
            print(f"{task.output}: holds this specimen already, nothing to do")
            return
    state = _done(task, "specimen")
    print(f"{task.output}: {described(state)}")
    for limit in exceeded_by(state):
        print(f"{task.output}: {limit}")


def _holds(state: State, task: SpecimenTask) -> bool:
    """Whether a state is just the specimen of the task; an earlier version wrote the side of `grains` alone."""
    try:
        recipe = restored(Recipe, json.loads(state.recipe))
        size = dataclasses.replace(recipe, side=recipe.side_of(state.scene), grains=None)
    except (TypeError, ValueError):  # of a layer, or of grains from elsewhere
        return False
    wanted = dataclasses.replace(task.recipe, side=task.recipe.side_of(task.scene), grains=None)
    return (size, state.scene, state.engine) == (wanted, task.scene, task.engine)


def consolidation_options(parser: argparse.ArgumentParser) -> None:
    """Options of a consolidation."""
    parser.add_argument("specimen", nargs="?", help="state file to start from")
    add_parameters(parser, Consolidation, leave_out=("rate", "strain"))
    add_engine_options(parser)
    parser.add_argument("-o", "--output", help="state file to write")


def consolidation_task(options: argparse.Namespace, history: str) -> ConsolidationTask:
    """The task of the options. Raises InputError for anything that cannot work."""
    require(options.pressure, "pressure", "e.g. 0.5e6 or '500 kPa'")
    path = make_path("cr", {"pressure": options.pressure})
    state = read_state(require(options.specimen, "specimen", "as a state file"))
    require_engine(options.engine, state.scene)
    require_pressure(path, state.scene)
    output = require(options.output, "output")
    require_writable(output, "state")
    return ConsolidationTask(
        state=state,
        source=options.specimen,
        pressure=path.start_pressure() or 0.0,
        engine=options.engine,
        threads=options.threads,
        output=output,
        history=history,
    )


@command("consolidate", consolidation_options)
def do_consolidate(options: argparse.Namespace, argv: list[str]) -> None:
    """Brings a specimen to a pressure and writes its state file."""
    consolidation(options, history_of(argv))


def consolidation(options: argparse.Namespace, history: str) -> None:
    """The same with a history of one's own, as inside YADE."""
    task = consolidation_task(options, history)
    state = _done(task, "consolidation")
    error = pressure_error(state.snapshot(), task.pressure)
    print(f"{task.output}: {described(state)}, pressure off by {error:.2%}")


def run_options(parser: argparse.ArgumentParser) -> None:
    """Options of a run; their names are also the columns of a yade-batch table."""
    parser.add_argument("path", nargs="?", help=f"loading path: {', '.join(PATHS)}")
    parser.add_argument("specimen", nargs="?", help="state file to start from")
    add_path_parameters(parser, PATHS.values())
    add_parameters(parser, Options)
    add_parameters(parser, Scene, leave_out=MADE_WITH, unset=True)
    add_settings_option(parser)
    add_engine_options(parser)
    parser.add_argument(
        "-o", "--output", help="run file to write or to go on with (default: a name made of the parameters)"
    )


def run_task(options: argparse.Namespace, history: str) -> RunTask:
    """The task of the options. Raises InputError for anything that cannot work."""
    kind = PATHS.require(require(options.path, "path", f"as one of {', '.join(PATHS)}"))
    state = read_state(require(options.specimen, "specimen", "as a state file"))
    chosen = settings(options.settings) if options.settings is not None else None
    state = state.replace(scene=run_scene(options, state.scene, chosen))
    require_engine(options.engine, state.scene)
    path = run_path(options, kind, chosen)
    path = path.starting_at(float(mean_stress(love_stress(state.snapshot()))))
    require_pressure(path, state.scene)
    recording = Options(**given(options, Options))  # type: ignore[arg-type]
    Schedule.of(path, state.scene.time_step, state.number_of_grains, recording)
    output = options.output or run_name(options, kind)
    require_writable(output, "run")
    return RunTask(
        state=state,
        source=options.specimen,
        path=path,
        options=recording,
        engine=options.engine,
        threads=options.threads,
        output=output,
        history=history,
    )


def run_scene(options: argparse.Namespace, scene: Scene, chosen: Settings | None) -> Scene:
    """The scene of a specimen with what the options change of it."""
    changes: dict[str, object] = {} if chosen is None else {"time_step_factor": chosen.time_step_factor}
    return dataclasses.replace(scene, **{**changes, **given(options, Scene)})


def run_path(options: argparse.Namespace, kind: type[Path], chosen: Settings | None) -> Path:
    """The path with the parameters of the options."""
    known = {name for one in PATHS.values() for name in parameters_of(one)}
    values = {name: getattr(options, name, None) for name in known}
    if chosen is not None and values.get("rate") is None:
        values["rate"] = kind.rate * chosen.rate_factor
    return make_path(kind.name, values)


def run_name(options: argparse.Namespace, kind: type[Path]) -> str:
    """A file name from the specimen, the path and the parameters that were given."""
    of_path = {name: _word(name, value) for name, value in _read(options, kind).items()}
    words = [File(options.specimen).name.removesuffix(".state.nc"), kind.name]
    words += [of_path.pop(name) for name in ("pressure", "strain", "rate") if name in of_path]
    words += [options.settings] if options.settings is not None else []
    words += [_word(name, value) for name, value in _read(options, Scene).items()]
    return str(File(options.specimen).with_name("_".join([*words, *of_path.values()]) + ".run.nc"))


def _read(options: argparse.Namespace, kind: type) -> dict[str, object]:
    """The parameters of a dataclass that the command line gives, in SI units."""
    return {name: parameters_of(kind)[name].read(text) for name, text in given(options, kind).items()}


def _word(name: str, value: object) -> str:
    """A parameter in the name of a file."""
    if name == "law":
        return str(value)
    if name == "pressure":
        return f"p{value / 1e3:g}kPa"  # type: ignore[operator]
    return SHORT.get(name, name) + (shown(value).replace(",", "_") if isinstance(value, tuple) else shown(value))


@command("run", run_options)
def do_run(options: argparse.Namespace, argv: list[str]) -> None:
    """Takes a specimen along a path into a run file; says so when that is done already."""
    run(options, history_of(argv))


def run(options: argparse.Namespace, history: str) -> None:
    """The same with a history of one's own, as inside YADE."""
    task = run_task(options, history)
    output = str(task.output)
    before = _finished(output)
    execute(task, reporter(task.path.name))
    print(f"{output}: " + ("was complete already, nothing to do" if before else "complete"))
    for limit in exceeded_in(output):
        print(f"{output}: {limit}")


def _finished(file: str) -> bool:
    """Whether a file is a run that is complete."""
    if not (File(file).exists() and labkit_kind(file) == "run"):
        return False
    with open_netcdf(file, "run") as dataset:
        return bool(dataset.complete)


def layer_options(parser: argparse.ArgumentParser) -> None:
    """Options of the stratified layer; their names are also the columns of a yade-batch table."""
    add_parameters(parser, Layer)
    add_engine_options(parser)
    parser.add_argument(
        "-o", "--output", default="stratified.state.nc", help="state file to write (default: stratified.state.nc)"
    )


def layer_task(options: argparse.Namespace, history: str) -> LayerTask:
    """The task of the options. Raises InputError for anything that cannot work."""
    layer = Layer(**given(options, Layer))  # type: ignore[arg-type]
    require_writable(options.output, "state")
    return LayerTask(
        layer=layer, engine=options.engine, threads=options.threads, output=options.output, history=history
    )


def stratified(options: argparse.Namespace, history: str) -> None:
    """Makes the stratified layer of Fig. 3 and writes its state file, unless the file holds just that layer."""
    task = layer_task(options, history)
    if File(options.output).exists() and read_state(options.output).recipe == task.layer.to_json():
        return
    state = _done(task, "layer")
    print(f"{options.output}: {state.number_of_grains} grains")


def _done(task: Task, title: str) -> State:
    state = execute(task, reporter(title))
    if state is None:
        raise InputError(f"a {task.kind} makes no state")
    return state


def described(state: State) -> str:
    """What one wants to know of a specimen, in one line."""
    return ", ".join(f"{name} {value:.4g} {unit}".rstrip() for name, (value, unit) in summary(state).items())
