"""Specimens made by compression of a gas of grains, to a void ratio or a pressure.

The grains are inserted at random in a large cell and moved apart until they form a gas without contacts. The cell is
then compressed at a constant rate, isotropic or along z only, with the friction of step 1. This friction determines the
density at a pressure: without friction the specimens are densest and best connected, with high friction loosest. At the
target the grains come to rest, first with the friction of step 1 and then with the friction of the scene.
"""

from __future__ import annotations

import math

import numpy as np

from labkit.engines.base import Engine, Progress, reload, silent
from labkit.engines.device import Device
from labkit.errors import PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.grains.time_step import critical_time_step, require_stable
from labkit.micro.stress import mean_stress
from labkit.paths.rates import default_rate
from labkit.paths.standard import Consolidation, IsotropicCompression
from labkit.process.progress import log_fraction
from labkit.records.energy import open_ledger
from labkit.specimens.consolidation import bring_to, level_stress
from labkit.specimens.fabric import SIGNS, shear_and_return
from labkit.specimens.recipe import Recipe
from labkit.specimens.specimen import FIRST, RELEASE_TIME_STEP, SECOND, STEP1, STEP2, insert_grains, release, settle

GAS = 2.0  # void ratio of the gas
RATE = 10.0  # rate of the compression, divided by the default rate of IsotropicCompression
CHECK = 50  # time steps between two checks of the pressure
DENSEST = 0.3  # void ratio at which a compression fails if it has not reached its pressure


def compress_gas(scene: Scene, recipe: Recipe, device: Device, progress: Progress = silent) -> State:
    """Return a State at rest at the nominal void ratio, or at the pressure, of the recipe.

    `device` creates the engine. Raises PhysicsError if the specimen does not come to rest or carries no load.
    """
    soft = scene.with_friction(recipe.step1_friction, recipe.step1_rolling_friction)
    engine = device(_gas(soft, recipe))
    engine.load(engine.state().replace(time_step=RELEASE_TIME_STEP * _limit(engine.state())))
    release(engine, lambda f, text: progress(0.2 * f, text))
    engine.load(open_ledger(engine.state().at_rest().replace(time_step=soft.time_step)))
    _compress(engine, recipe, lambda f, text: progress(0.2 + 0.3 * f, text))
    state = engine.state()
    require_stable(state)
    if recipe.pressure is None:
        settle(engine, STEP1, lambda f, text: progress(0.5 + 0.2 * f, f"{FIRST}: {text}"))
        engine.load(open_ledger(_with_scene(engine.state(), scene, device)))
        settle(engine, STEP2, lambda f, text: progress(0.7 + 0.2 * f, f"{SECOND}: {text}"))
        packed = reload(engine).at_rest()
        if recipe.cell == "free":
            packed = level_stress(packed, STEP2.unbalanced_force, device, lambda f, text: progress(0.9 + 0.1 * f, text))
    else:
        target = Consolidation(pressure=recipe.pressure, cell=recipe.cell)
        soft_state = bring_to(state, target, device, lambda f, text: progress(0.5 + 0.3 * f, text))
        switched = _with_scene(soft_state, scene, device)
        packed = bring_to(switched, target, device, lambda f, text: progress(0.8 + 0.1 * f, text))
        if recipe.fabric in SIGNS:
            sheared = shear_and_return(packed, SIGNS[recipe.fabric], target, device)
            packed = bring_to(sheared, target, device, lambda f, text: progress(0.9 + 0.1 * f, text))
    return packed.replace(recipe=recipe.to_json())


def _gas(scene: Scene, recipe: Recipe) -> State:
    """Insert the grains of the recipe at random in a cell with the void ratio of a gas."""
    inserted = insert_grains(scene, recipe)
    along = _along(recipe)
    stretch = np.where(along, ((1.0 + GAS) / (1.0 + recipe.size_ratio)) ** (1.0 / along.sum()), 1.0)
    return recipe.give_shapes(inserted.replace(position=inserted.position * stretch, cell=inserted.cell * stretch))


def _along(recipe: Recipe) -> np.ndarray:
    """Return the axes (3,) along which the gas is compressed: 1 or 0."""
    return np.array([0.0, 0.0, 1.0]) if recipe.fabric == "deposited" else np.ones(3)


def _with_scene(state: State, scene: Scene, device: Device) -> State:
    """Return the state at rest with the friction of `scene`, after the engine has reduced forces to the new limits."""
    return device(state.at_rest().replace(scene=scene)).state()


def _limit(state: State) -> float:
    """Return the critical time step of the inserted grains, or the time step of the state if no grains touch."""
    limit = critical_time_step(state)
    return limit if math.isfinite(limit) else state.time_step


def _compress(engine: Engine, recipe: Recipe, progress: Progress) -> None:
    """Compress the cell until the void ratio, or the pressure, of the recipe is reached."""
    state = engine.state()
    solid = state.volume / (1.0 + GAS)
    end = solid * (1.0 + (recipe.void_ratio if recipe.pressure is None else DENSEST))
    rate = RATE * default_rate(IsotropicCompression, state.scene)
    steps = math.ceil(math.log(state.volume / end) / (3.0 * rate * state.time_step))
    along = _along(recipe)
    gradient = np.diag(along) * math.expm1(math.log(end / state.volume) / (along.sum() * steps)) / state.time_step
    for step in range(0, steps, CHECK):
        engine.advance(min(CHECK, steps - step), gradient)
        pressure = float(mean_stress(engine.stress()))
        if recipe.pressure is None:
            progress(step / steps, f"compression, {pressure:.3g} Pa")
        else:
            progress(log_fraction(1e-6, max(pressure / recipe.pressure, 1e-6), 1.0), f"compression, {pressure:.3g} Pa")
            if pressure >= recipe.pressure:
                return
    if recipe.pressure is not None:
        raise PhysicsError(f"the pressure did not reach {recipe.pressure:.3g} Pa at a void ratio of {DENSEST:g}")
