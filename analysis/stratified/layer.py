"""The stratified example of Fig. 3: a plane periodic layer, coarse above fine grains, under sigma_zz = 2 sigma_xx.

The layer is one grain thick in a thicker periodic cell, because YADE requires a cell wider than two grains. Grains
cannot leave the plane. Stresses are forces divided by the thickness of the cell. A grain represents a disc of that
thickness, so its volume in the normalised force is pi D^2/4 times the thickness.

At equilibrium sigma_zz is equal in both strata; the servo controls only the mean of sigma_xx. With a few hundred coarse
grains, the distribution of sigma_xx between the strata is random and sensitive to rounding: sigma_zz/sigma_xx of the
coarse stratum was 2.00 for the default seed in YADE and 2.08 in `fused`, and 1.95 to 2.3 for other seeds.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from labkit.engines.base import Progress, silent
from labkit.engines.device import Device
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.time_step import require_stable
from labkit.micro.contact_sides import normalised_normal_force
from labkit.micro.networks import strong_by_force, strong_by_normalised_force
from labkit.micro.size_groups import group_stresses
from labkit.parameters import Number, check_parameters, parameter, without_option
from labkit.paths.standard import PRESSURE_LIMIT, Biaxial
from labkit.specimens.consolidation import bring_to
from labkit.specimens.specimen import relax, spatial_order

SCENE = Scene(planar=True)
THICKNESS = 2.3  # thickness of the cell, divided by the diameter of the largest grain
STAGES = 3  # number of stress ratios at which the layer comes to rest, from isotropic to the final stress ratio


@dataclasses.dataclass(frozen=True)
class Layer:
    """Parameters of the layer: two strata of equal height, of which the upper is `size_ratio` times as coarse.

    Raises InputError for values outside their ranges.

    Args:
        size_ratio: Coarse diameter divided by fine diameter.
        width: Width of the layer, in mean coarse diameters.
        height: Height of the layer, in mean coarse diameters.
        void_ratio: Area of voids divided by area of discs.
        step1_friction: mu during preparation.
        pressure: sigma_xx, Pa.
        ratio: sigma_zz/sigma_xx.
        seed: Random seed of the insertion.
    """

    size_ratio: Number[float] = parameter(2.0, low=1.0, high=5.0, help="coarse diameter divided by fine diameter")
    width: Number[float] = parameter(30.0, low=8.0, high=200.0, help="width of the layer, in coarse diameters")
    height: Number[float] = parameter(
        30.0, low=8.0, high=200.0, help="height of both strata together, in coarse diameters"
    )
    void_ratio: Number[float] = without_option(
        parameter(0.19, low=0.1, high=0.3, help="area of voids divided by area of discs")
    )
    step1_friction: Number[float] = without_option(
        parameter(0.2, low=0.0, high=10.0, help="friction coefficient mu during preparation")
    )
    pressure: Number[float] = parameter(0.1e6, unit="Pa", low=1e3, high=PRESSURE_LIMIT, help="sigma_xx")
    ratio: Number[float] = parameter(2.0, low=0.5, high=3.0, help="target stress ratio sigma_zz/sigma_xx")
    seed: Number[int] = parameter(3, low=0, high=2**31 - 1, help="random seed of the insertion")

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)

    def to_json(self) -> str:
        """Return the layer as JSON, for files."""
        return json.dumps(dataclasses.asdict(self))


def insert_layer(layer: Layer, scene: Scene) -> State:
    """Insert grains at random with overlap in two strata, both at the plane void ratio; returns a State.

    Discs lie entirely within their stratum: coarse discs protruding into the fine stratum would make it the denser of
    the two, and the strata would reach equal sigma_zz with unequal sigma_xx.
    """
    rng = np.random.default_rng(layer.seed)
    coarse = layer.size_ratio * scene.mean_diameter
    width, height = layer.width * coarse, layer.height * coarse
    thickness = THICKNESS * coarse * (1.0 + scene.diameter_spread)
    area = width * 0.5 * height / (1.0 + layer.void_ratio)
    strata = [
        _draw_discs(scene.mean_diameter * size, scene.diameter_spread, area, rng) for size in (1.0, layer.size_ratio)
    ]
    radius = np.concatenate(strata)
    floor = np.repeat([0.0, 0.5 * height], [len(stratum) for stratum in strata])
    z = floor + radius + rng.random(len(radius)) * (0.5 * height - 2.0 * radius)
    position = np.stack([rng.random(len(radius)) * width, np.full(len(radius), 0.5 * thickness), z], axis=1)
    order = spatial_order(position, height, coarse)
    return grains_in_cell(scene, radius[order], position[order], np.diag([width, thickness, height]), layer.seed)


def _draw_discs(diameter: float, spread: float, area: float, rng: np.random.Generator) -> np.ndarray:
    """Draw radii of discs uniformly about a mean diameter, scaled to fill an area exactly, m."""
    mean = np.pi / 4.0 * diameter**2 * (1.0 + spread**2 / 3.0)
    radius = 0.5 * diameter * (1.0 + spread * rng.uniform(-1.0, 1.0, round(area / mean)))
    return radius * np.sqrt(area / np.sum(np.pi * radius**2))


def make_layer(layer: Layer, device: Device, progress: Progress = silent) -> State:
    """Make the layer, at rest under its stresses; returns a State. Raises PhysicsError if it does not come to rest."""
    inserted = insert_layer(layer, SCENE.with_friction(layer.step1_friction, SCENE.rolling_friction))
    state = relax(inserted, SCENE, device, lambda f, text: progress(0.6 * f, text))
    require_stable(state)
    for stage in range(STAGES):
        ratio = 1.0 + (layer.ratio - 1.0) * stage / (STAGES - 1)
        path = Biaxial(stress_x=layer.pressure, stress_z=ratio * layer.pressure)

        def report_stage(fraction: float, text: str, stage: int = stage) -> None:
            progress(0.6 + 0.4 * (stage + fraction) / STAGES, text)

        state = bring_to(state, path, device, report_stage)
    return state.replace(recipe=layer.to_json())


@dataclasses.dataclass(frozen=True)
class Stratum:
    """One stratum of the layer, with means over its contact sides and the stresses of its grains."""

    name: str
    grains: int
    contacts: int
    stress_ratio: float  # sigma_zz/sigma_xx
    mean_force: float  # N
    mean_normalised_force: float  # Lambda_n, for discs
    strong_by_force: float  # fraction of contact sides above the mean of the whole layer
    strong_by_normalised_force: float


def disc_volume(state: State) -> np.ndarray:
    """Return the volume of each disc, pi D^2/4 times the thickness of the cell, shape (grain,), m3."""
    return np.pi * state.radius**2 * state.cell[1, 1]


def stratum_of(state: State) -> np.ndarray:
    """Return the stratum of each grain, shape (grain,): 0 for the lower, fine stratum, 1 for the upper, coarse stratum.

    The widest gap between the diameters separates the strata.
    """
    ascending = np.sort(state.radius)
    widest = int(np.argmax(np.diff(ascending)))
    return (state.radius > 0.5 * (ascending[widest] + ascending[widest + 1])).astype(int)


def strata(state: State) -> list[Stratum]:
    """Return the coarse upper stratum and the fine lower stratum, in this order."""
    snapshot, group = state.snapshot(), stratum_of(state)
    contacts, volume = snapshot.contacts, disc_volume(state)
    stresses = group_stresses(snapshot, group, 2)
    normalised = normalised_normal_force(snapshot, volume)
    side = group[contacts.grain]
    force = np.stack([contacts.normal_force] * 2, axis=1)
    by_force = strong_by_force(snapshot)
    by_normalised = strong_by_normalised_force(snapshot, volume)
    return [
        Stratum(
            name,
            int(stresses.grains[k]),
            int(stresses.contacts[k]),
            float(stresses.per_contact[k, 2, 2] / stresses.per_contact[k, 0, 0]),
            *(float(values[side == k].mean()) for values in (force, normalised, by_force, by_normalised)),
        )
        for k, name in ((1, "upper, coarse"), (0, "lower, fine"))
    ]
