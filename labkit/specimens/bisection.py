"""Specimens of a given void ratio at a given pressure: the friction during the compression is found by bisection."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.base import Progress, silent
from labkit.engines.device import Device
from labkit.errors import PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.specimens.compression import compress_gas
from labkit.specimens.recipe import USUAL_VOID_RATIO, Recipe

TRIALS = 20  # compressions in the search for a void ratio
HALVINGS = 6  # trials after which halving changes the void ratio by less than specimens of equal friction scatter
NEAREST = 5  # trials in the line that is then fitted to the void ratio
FIRST_SHARE = 0.3  # fraction of the scene's friction in the first trial


def compression_recipe(share: float, scene: Scene, pressure: float, grains: int, seed: int) -> Recipe:
    """Return the recipe of a specimen compressed to a pressure, Pa, with a fraction of the scene's friction."""
    return Recipe(
        grains=grains,
        seed=seed,
        preparation="compression",
        pressure=pressure,
        step1_friction=share * scene.friction,
        step1_rolling_friction=share * scene.rolling_friction,
    )


def trial_recipe(recipe: Recipe, share: float, scene: Scene) -> Recipe:
    """Return the recipe of a specimen compressed to the pressure of `recipe`, with a fraction of the scene's friction.

    The void ratio only determines the size.
    """
    return dataclasses.replace(
        recipe,
        void_ratio=recipe.void_ratio if recipe.grains is None else USUAL_VOID_RATIO,
        preparation="compression",
        tolerance=Recipe.tolerance,
        step1_friction=share * scene.friction,
        step1_rolling_friction=share * scene.rolling_friction,
    )


def find_friction(scene: Scene, recipe: Recipe, device: Device, progress: Progress = silent) -> State:
    """Return a State at rest at the pressure of the recipe, whose nominal void ratio is that of the recipe.

    The friction and rolling friction during the compression are the scene's values times the same factor. Raises
    PhysicsError if no factor gives the void ratio within the tolerance of the recipe. If the first two are too loose or
    too dense, the third is the end of the range, 0 or 1. Near the factor the void ratio scatters, because a slightly
    different friction leads to a different packing; a line through the nearest trials then replaces bisection.
    """
    low, high, share, text = 0.0, 1.0, FIRST_SHARE, ""
    trials: list[tuple[float, float]] = []
    for trial in range(TRIALS):
        compressed = compress_gas(scene, trial_recipe(recipe, share, scene), device, _of_trial(trial, text, progress))
        reached = void_ratio_nominal(compressed.snapshot())
        text = f"{share:.1%} of the friction: void ratio {reached:.4f}"
        if abs(reached - recipe.void_ratio) < recipe.tolerance:
            return compressed.replace(recipe=recipe.to_json())
        trials.append((share, reached))
        end = 1.0 if reached < recipe.void_ratio else 0.0
        if share == end or scene.friction == scene.rolling_friction == 0.0:
            break
        low, high = (share, high) if end else (low, share)
        share = end if trial == 1 and end in (low, high) else 0.5 * (low + high)
        if len(trials) >= HALVINGS:
            share = share_by_line(trials, recipe.void_ratio)
    raise PhysicsError(
        f"no friction gives a void ratio of {recipe.void_ratio:.4f} at {recipe.pressure:.3g} Pa (the last gave "
        f"{reached:.4f}): choose one between e_min and e_max, which labkit density measures, more grains or a "
        "larger tolerance"
    )


def share_by_line(trials: list[tuple[float, float]], void_ratio: float) -> float:
    """Return the share at which a line through the nearest trials (share, void ratio) has a void ratio.

    It lies within these trials, and none of them has had it.
    """
    shares, reached = np.array(sorted(trials, key=lambda trial: abs(trial[1] - void_ratio))[:NEAREST]).T
    apart = shares - shares.mean()
    slope = float(apart @ reached / (apart @ apart))
    share = shares.mean() + ((void_ratio - reached.mean()) / slope if slope > 0.0 else 0.0)
    share = float(np.clip(share, shares.min(), shares.max()))
    while any(share == before for before, _ in trials):
        share = 0.5 * (share + next(float(other) for other in shares if other != share))
    return share


def _of_trial(trial: int, last: str, progress: Progress) -> Progress:
    """Return the progress function of one trial, which also reports the result of the last one."""
    return lambda fraction, text: progress((trial + fraction) / TRIALS, last or text)
