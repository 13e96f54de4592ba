"""Specimens (section 2): grains inserted at random with overlap, relaxed in two steps, and their shear stresses."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.engines.base import Engine, Progress, reload, silent
from labkit.engines.device import Device
from labkit.errors import PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.time_step import critical_time_step, require_stable
from labkit.micro.cells import relative_width
from labkit.micro.fabric import contact_anisotropy
from labkit.micro.indicators import elastic_energy, overlap_ratio, redundancy_index, unbalanced_force
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import equivalent_stress, mean_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.process.progress import log_fraction
from labkit.records.energy import kinetic_energy, open_ledger, require_balanced
from labkit.servo.correction import cell_stiffness
from labkit.specimens.consolidation import level_stress
from labkit.specimens.recipe import Recipe

FIRST, SECOND = "step 1 of 2, friction of the preparation", "step 2 of 2, friction of the tests"


@dataclasses.dataclass(frozen=True)
class Equilibrium:
    """Criteria for a specimen at rest, and the largest number of steps to reach them."""

    unbalanced_force: float
    energy_ratio: float  # kinetic energy/elastic energy
    check_interval: int = 250  # time steps
    step_limit: int = 100_000


STEP1 = Equilibrium(unbalanced_force=1e-3, energy_ratio=1e-4)
STEP2 = Equilibrium(unbalanced_force=1e-4, energy_ratio=1e-5)

# The deep overlaps after a random insertion are relaxed with small time steps, and the grains are stopped repeatedly. A
# spring system that is stopped after a time T retains the fraction cos(omega T) of each mode, so no mode grows.
RELEASE_TIME_STEP = 0.25  # fraction of the critical time step of the inserted grains
RELEASE_STEPS = 20  # time steps between two stops
RELEASE_UNBALANCED = 0.03
RELEASE_LIMIT = 500  # largest number of stops


def draw_radii(scene: Scene, solid_volume: float, rng: np.random.Generator) -> np.ndarray:
    """Draw radii (grain,), m, with a total volume of `solid_volume`, m3, from the distribution of diameters.

    See labkit.grains.grading for a scene with a grading. For the uniform distribution about the mean diameter, grains
    are drawn until the missing volume is less than the volume of two of the largest grains; two equal grains then make
    up the remainder exactly. Their diameter lies within the distribution for any spread below 0.22; for a larger spread
    it does not exceed the mean diameter.
    """
    if scene.grading is not None:
        return scene.sizes.draw(solid_volume, rng)
    low, high = (0.5 * scene.mean_diameter * (1.0 + s * scene.diameter_spread) for s in (-1.0, 1.0))
    two_largest = 2.0 * 4.0 / 3.0 * np.pi * high**3
    radii, missing = [], solid_volume
    while missing >= two_largest:
        radii.append(rng.uniform(low, high))
        missing -= 4.0 / 3.0 * np.pi * radii[-1] ** 3
    return np.array(radii + [(missing / 2.0 * 3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)] * 2)


def in_classes(radius: np.ndarray, classes: int) -> np.ndarray:
    """Round radii to midpoints of classes of equal width, times a factor close to 1 that preserves the total volume."""
    low, high = radius.min(), radius.max()
    width = (high - low) / classes
    if width == 0.0:
        return radius
    rounded = low + width * (np.minimum((radius - low) // width, classes - 1) + 0.5)
    return rounded * (np.sum(radius**3) / np.sum(rounded**3)) ** (1.0 / 3.0)


def spatial_order(position: np.ndarray, side: float, mean_diameter: float) -> np.ndarray:
    """Return an order of the grains, by cells two diameters wide, in which neighbours in space are close in memory."""
    block = np.floor(position / side * max(1, int(side / (2 * mean_diameter)))).astype(int)
    return np.lexsort(block.T)


def insert_grains(scene: Scene, recipe: Recipe) -> State:
    """Return a State of grains inserted at random with overlap, at exactly the nominal void ratio."""
    side = recipe.side_of(scene)
    rng = np.random.default_rng(recipe.seed)
    lengths = side * np.array([1.0, 1.0, recipe.aspect])
    radius = draw_radii(scene, side**3 * recipe.aspect / (1.0 + recipe.size_ratio), rng)
    if recipe.size_classes is not None:
        radius = in_classes(radius, recipe.size_classes)
    position = rng.random((len(radius), 3)) * lengths
    order = spatial_order(position, side, scene.mean_diameter)
    return grains_in_cell(scene, radius[order], position[order], np.diag(lengths), recipe.seed)


def prepare_specimen(scene: Scene, recipe: Recipe, device: Device, progress: Progress = silent) -> State:
    """Return a State at rest at the nominal void ratio, prepared in the two steps of section 2.

    If the cell of the recipe is free, it then shears until the stress is isotropic. `device` creates the engine. Raises
    PhysicsError if the specimen does not come to rest.
    """
    share = 1.0 if recipe.cell == "fixed" else 0.8
    inserted = insert_grains(scene.with_friction(recipe.step1_friction, recipe.step1_rolling_friction), recipe)
    state = relax(recipe.give_shapes(inserted), scene, device, lambda f, text: progress(share * f, text))
    if recipe.cell == "free":
        state = level_stress(state, STEP2.unbalanced_force, device, lambda f, text: progress(0.8 + 0.2 * f, text))
    return state.replace(recipe=recipe.to_json())


def relax(inserted: State, scene: Scene, device: Device, progress: Progress = silent) -> State:
    """Return inserted grains, relaxed to rest with their own friction in step 1 and that of `scene` in step 2."""
    engine = device(inserted)
    engine.load(inserted.replace(time_step=RELEASE_TIME_STEP * critical_time_step(engine.state())))
    release(engine, lambda f, text: progress(0.3 * f, text))
    released = engine.state().replace(time_step=inserted.scene.time_step)
    require_stable(released)
    engine.load(open_ledger(released))
    settle(engine, STEP1, lambda f, text: progress(0.3 + 0.3 * f, f"{FIRST}: {text}"))
    engine.load(open_ledger(engine.state().at_rest().replace(scene=scene)))
    settle(engine, STEP2, lambda f, text: progress(0.6 + 0.4 * f, f"{SECOND}: {text}"))
    return reload(engine).at_rest()


def release(engine: Engine, progress: Progress) -> None:
    """Relax the deep overlaps, stopping the grains every few time steps; `settle` relaxes the remaining overlaps."""
    still = np.zeros((3, 3))
    first = None
    for stop in range(RELEASE_LIMIT):
        engine.advance(RELEASE_STEPS, still)
        engine.stop_grains()
        if stop % 10 == 9:
            unbalanced = unbalanced_force(engine.state().snapshot())
            first = first or unbalanced
            progress(
                log_fraction(first, unbalanced, RELEASE_UNBALANCED),
                f"relaxing overlaps, unbalanced force {unbalanced:.2g}",
            )
            if unbalanced < RELEASE_UNBALANCED:
                return


def settle(engine: Engine, target: Equilibrium, progress: Progress) -> None:
    """Advance in the fixed cell until the specimen is at rest. Raises PhysicsError at the step limit."""
    still = np.zeros((3, 3))
    first = None
    for _ in range(0, target.step_limit, target.check_interval):
        engine.advance(target.check_interval, still)
        state = engine.state()
        snapshot = state.snapshot()
        contacts, grains = len(snapshot.contacts), snapshot.number_of_grains
        if contacts < grains:
            raise PhysicsError(
                f"the grains have separated (coordination number {2 * contacts / grains:.2g}): at a "
                f"friction of {state.scene.friction:g} they carry no load at this void ratio: decrease it or increase "
                "step1_friction; for a specimen at a pressure give preparation = compression, or use labkit.specimen_at"
            )
        require_balanced(state, snapshot)
        unbalanced = unbalanced_force(snapshot)
        elastic = elastic_energy(snapshot)
        energy = kinetic_energy(state) / abs(elastic) if elastic else np.inf  # adhesion can make it negative
        first = first or max(unbalanced, energy)
        progress(log_fraction(first, unbalanced, target.unbalanced_force), f"unbalanced force {unbalanced:.2g}")
        if unbalanced < target.unbalanced_force:
            if energy < target.energy_ratio:
                progress(1.0, f"unbalanced force {unbalanced:.2g}")
                return
            engine.stop_grains()  # stop the rattlers, which would keep moving; the other grains must stay at rest
    pressure = mean_stress(love_stress(snapshot))
    raise PhysicsError(
        f"the specimen is not at rest after {target.step_limit} steps (unbalanced force {unbalanced:.2g}, "
        f"kinetic/elastic energy {energy:.2g}, pressure {pressure:.3g} Pa): "
        "decrease the void ratio or increase step1_friction, so that the specimen carries load"
    )


def specimen_summary(state: State) -> dict[str, tuple[float, str]]:
    """Summarise a specimen, name -> (value, unit)."""
    snapshot = state.snapshot()
    grains, contacts, limit = snapshot.number_of_grains, len(snapshot.contacts), critical_time_step(state, snapshot)
    stress = love_stress(snapshot)
    values = {
        "grains": (grains, ""),
        "contacts": (contacts, ""),
        "mean diameter by number": (2.0 * float(snapshot.radius.mean()), "m"),
        "cell width/largest grain": (relative_width(state.cell, state.body_radius), ""),
        "void ratio, nominal": (void_ratio_nominal(snapshot), ""),
        "void ratio": (void_ratio(snapshot), ""),
        "mean stress": (float(mean_stress(stress)), "Pa"),
        "q (invariant)": (float(equivalent_stress(stress)), "Pa"),
        "coordination number": (2 * contacts / grains, ""),
        "mean overlap": (overlap_ratio(snapshot), "D"),
        "unbalanced force": (unbalanced_force(snapshot), ""),
        "time step": (state.time_step, "s"),
    }
    if contacts:
        if not {"cohesion", "bond"} & set(state.scene.contact_law.acting(state.scene)):
            values["redundancy index"] = redundancy_index(snapshot), ""
        values["Skempton's B, at least"] = skempton_b(snapshot), ""
        values["contact anisotropy A_zz"] = float(contact_anisotropy(snapshot.contacts.normal)[2, 2]), ""
    if np.isfinite(limit):  # finite only if the specimen has contacts
        values["time step/critical time step"] = state.time_step / limit, ""
    return values


BULK_MODULUS = 2.2e9  # Pa, of water without air


def skempton_b(snapshot: Snapshot, bulk_modulus: float = BULK_MODULUS) -> float:
    """Return the least B = du/dp of the saturated specimen when the total mean stress p rises undrained.

        B = 1/(1 + n K/K_w)        n = e/(1 + e)

    K is the bulk modulus (Pa) of the skeleton if all grains moved with the mean field. The real one is smaller because
    contacts slip and grains rearrange, so B is at least this. Grains count as incompressible. As K_w grows, B tends to
    1, and an undrained test to one at constant volume.

    Args:
        snapshot: The specimen.
        bulk_modulus: Bulk modulus K_w of the pore water with the air in it, Pa.
    """
    skeleton, e = float(cell_stiffness(snapshot).sum()) / 9.0, void_ratio(snapshot)
    return 1.0 / (1.0 + e / (1.0 + e) * skeleton / bulk_modulus)
