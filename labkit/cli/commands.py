"""What `labkit specimen`, `consolidate` and `run` do, in whichever interpreter the engine needs."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

from labkit.cli.arguments import require
from labkit.dem.consolidation import consolidate, pressure_error
from labkit.engines import require_law
from labkit.errors import InputError
from labkit.io.files import open_netcdf, require_writable
from labkit.dem.limits import RECORDED, exceeded, exceeded_by
from labkit.micro.stress import love_stress, mean_stress
from labkit.dem.paths import Consolidation, make_path, path_class
from labkit.io.provenance import provenance
from labkit.dem.scene import Scene
from labkit.dem.settings import settings
from labkit.dem.simulation import Schedule, run
from labkit.dem.specimen import Recipe, make_specimen, require_size, side_for, summary
from labkit.dem.state import read_state, write_state
from labkit.dem.stratified import Layer, make_layer


def check_specimen(options):
    """Recipe and Scene of the options. Raises InputError for anything that cannot work, before work begins."""
    void_ratio = require(options.void_ratio, "--void-ratio")
    chosen = settings(options.settings or "standard")
    factor = chosen.time_step_factor if options.time_step_factor is None else options.time_step_factor
    scene = Scene(law=options.law, time_step_factor=factor)
    require_law(options.engine, scene)
    side, grains = options.side, options.grains
    if side is None and grains is None:
        side, grains = chosen.side, chosen.grains
    if grains is not None:
        Recipe(void_ratio)
        side = side_for(grains, void_ratio, scene)
    recipe = Recipe(void_ratio, options.step1_friction, options.step1_rolling_friction, side, options.seed)
    options.output = options.output or specimen_name(recipe, grains, scene)
    require_size(recipe, scene)
    require_writable(options.output, "state")
    return recipe, scene


def specimen_name(recipe, grains, scene):
    """A file name from the parameters."""
    size = f"n{grains}" if grains else f"l{recipe.side:g}"
    friction = f"f{recipe.step1_friction:g}_r{recipe.step1_rolling_friction:g}"
    suffix = "" if scene.law == Scene.law else f"_{scene.law}"
    suffix += "" if scene.time_step_factor == Scene.time_step_factor else f"_t{scene.time_step_factor:g}"
    return f"e{recipe.void_ratio:g}_{friction}_{size}_s{recipe.seed}{suffix}.state.nc"


def specimen(options, progress, history):
    """Makes a specimen and writes its state file, unless the file is there and holds just that specimen."""
    recipe, scene = check_specimen(options)
    text = json.dumps(dataclasses.asdict(recipe))
    if Path(options.output).exists():
        there = read_state(options.output)
        if (there.recipe, there.scene, there.engine) == (text, scene, options.engine):
            print(f"{options.output}: holds this specimen already, nothing to do")
            return
    state = make_specimen(scene, recipe, options.engine, options.threads, progress)
    made = provenance(history, output=options.output, seed=recipe.seed)
    write_state(options.output, state.replace(history=history, recipe=text, provenance=made))
    print(f"{options.output}: " + describe(summary(state)))
    for sentence in exceeded_by(state):
        print(f"{options.output}: {sentence}")


def check_consolidation(options):
    """The specimen and the pressure of the options. Raises InputError for anything that cannot work."""
    pressure = require(options.pressure, "--pressure")
    make_path("cr", pressure=pressure)
    state = read_state(require(options.specimen, "the specimen (a state file)"))
    require_law(options.engine, state.scene)
    require_writable(require(options.output, "--output"), "state")
    return state, Consolidation(pressure)


def consolidation(options, progress, history):
    """Brings a specimen to a pressure and writes its state file."""
    state, path = check_consolidation(options)
    state = consolidate(state, path.pressure, options.engine, options.threads, progress)
    made = provenance(history, [options.specimen], options.output, state.seed)
    write_state(options.output, state.replace(history=state.history + "\n" + history, provenance=made))
    print(f"{options.output}: {describe(summary(state))}, pressure off by {pressure_error(state.snapshot(), path.pressure):.2%}")


def check_layer(options):
    """The Layer of the options. Raises InputError for anything that cannot work."""
    layer = Layer(**{name: getattr(options, name) for name in LAYER_OPTIONS})
    require_writable(options.output, "state")
    return layer


def stratified(options, progress, history):
    """Makes the stratified layer of Fig. 3 and writes its state file."""
    layer = check_layer(options)
    state = make_layer(layer, options.engine, options.threads, progress)
    made = provenance(history, output=options.output, seed=layer.seed)
    recipe = json.dumps(dataclasses.asdict(layer))
    write_state(options.output, state.replace(history=history, recipe=recipe, provenance=made))
    print(f"{options.output}: {state.number_of_grains} grains")


LAYER_OPTIONS = ("size_ratio", "width", "height", "pressure", "ratio", "seed")


def check_run(options):
    """Path and specimen of the options. Raises InputError for anything that cannot work."""
    kind = path_class(require(options.path, "the path"))
    state = read_state(require(options.specimen, "the specimen (a state file)"))
    rate, factor = options.rate, options.time_step_factor
    if options.settings is not None:
        chosen = settings(options.settings)
        rate = kind.rate * chosen.rate_factor if rate is None else rate
        factor = chosen.time_step_factor if factor is None else factor
    given = {"time_step_factor": factor, "law": options.law}
    scene = dataclasses.replace(state.scene, **{name: value for name, value in given.items() if value is not None})
    require_law(options.engine, scene)
    state = state.replace(scene=scene)
    path = make_path(
        options.path, mean_stress(love_stress(state.snapshot())),
        pressure=options.pressure, strain=options.strain, rate=rate, reversals=options.reversals,
    )  # fmt: skip
    interval = options.record_strain
    if interval is not None and not (math.isfinite(interval) and 0.0 < interval <= 1.0):
        raise InputError(f"--record-strain {interval:g} is not possible: give e.g. 1e-3")
    if options.snapshots < 0:
        raise InputError(f"--snapshots {options.snapshots} is not possible: give 0 or more")
    Schedule.of(path, state.scene.time_step, state.number_of_grains, interval or path.record_strain, options.snapshots)
    options.output = options.output or run_name(options)
    require_writable(options.output, "run")
    return path, state


def run_name(options):
    """A file name from the specimen, the path and the parameters that were given."""
    words = [Path(options.specimen).name.removesuffix(".state.nc"), options.path]
    words += [f"p{options.pressure / 1e3:g}kPa"] if options.pressure is not None else []
    words += [f"e{options.strain:g}"] if options.strain is not None else []
    words += [f"r{options.rate:g}"] if options.rate is not None else []
    words += [options.settings] if options.settings is not None else []
    words += [f"t{options.time_step_factor:g}"] if options.time_step_factor is not None else []
    words += [options.law] if options.law is not None else []
    words += ["c" + "_".join(f"{x:g}" for x in options.reversals)] if options.reversals is not None else []
    return str(Path(options.specimen).with_name("_".join(words) + ".run.nc"))


def run_path(options, progress, history):
    """Takes a specimen along a path into a run file; says so when that is done already."""
    path, state = check_run(options)
    made = provenance(history, [options.specimen], options.output, state.seed)
    done = run(
        state.replace(history=state.history + "\n" + history, provenance=made), path, options.output, options.engine,
        options.threads, options.record_strain, options.snapshots, options.save_every, progress,
    )  # fmt: skip
    print(f"{options.output}: " + ("complete" if done else "was complete already, nothing to do"))
    with open_netcdf(options.output, "run") as dataset:
        for sentence in exceeded({name: dataset[name][...].filled() for name in RECORDED}):
            print(f"{options.output}: {sentence}")


def describe(quantities):
    return ", ".join(f"{name} {value:.4g} {unit}".rstrip() for name, (value, unit) in quantities.items())
