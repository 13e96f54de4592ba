"""What `labkit specimen` and `labkit run` do, in whichever interpreter the engine needs."""

from __future__ import annotations

import math

from labkit.arguments import require
from labkit.errors import InputError
from labkit.files import require_writable
from labkit.paths import make_path
from labkit.scene import Scene
from labkit.simulation import run
from labkit.specimen import Recipe, insert_grains, make_specimen, side_for, summary
from labkit.state import read_state, write_state


def check_specimen(options):
    """The Recipe of the options. Raises InputError for anything that cannot work, before work begins."""
    void_ratio = require(options.void_ratio, "--void-ratio")
    output = require(options.output, "--output")
    scene = Scene()
    if not math.isfinite(options.side) or not 0.0 < options.side <= 1.0:
        raise InputError(f"--side {options.side:g} is not possible: give metres, e.g. 4e-3")
    recipe = Recipe(void_ratio, options.step1_friction, options.step1_rolling_friction, options.side, options.seed)
    if options.grains is not None:
        side = side_for(options.grains, void_ratio, scene)
        recipe = Recipe(void_ratio, options.step1_friction, options.step1_rolling_friction, side, options.seed)
    insert_grains(scene, recipe)
    require_writable(output)
    return recipe


def specimen(options, progress, history):
    """Makes a specimen and writes its state file."""
    recipe = check_specimen(options)
    state = make_specimen(Scene(), recipe, options.engine, options.threads, progress)
    write_state(options.output, state.replace(history=history))
    print(f"{options.output}: " + describe(summary(state)))


def check_run(options):
    """Path and specimen of the options. Raises InputError for anything that cannot work."""
    path = make_path(require(options.path, "the path"), rate=options.rate, strain=options.strain)
    if not 0.0 < options.record_strain <= 1.0:
        raise InputError(f"--record-strain {options.record_strain:g} is not possible: give e.g. 1e-3")
    if options.snapshots < 0:
        raise InputError(f"--snapshots {options.snapshots} is not possible: give 0 or more")
    state = read_state(require(options.specimen, "the specimen (a state file)"))
    require_writable(require(options.output, "--output"))
    return path, state


def run_path(options, progress, history):
    """Takes a specimen along a path into a run file; says so when that is done already."""
    path, state = check_run(options)
    done = run(
        state.replace(history=history), path, options.output, options.engine, options.threads,
        options.record_strain, options.snapshots, progress,
    )  # fmt: skip
    print(f"{options.output}: " + ("complete" if done else "was complete already, nothing to do"))


def describe(quantities):
    return ", ".join(f"{name} {value:.4g} {unit}".rstrip() for name, (value, unit) in quantities.items())
