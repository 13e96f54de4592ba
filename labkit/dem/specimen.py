"""Specimens (section 2): grains inserted at random with overlap, relaxed in two steps in a held cell."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.dem.energy import opened, require_balanced
from labkit.engines import start_engine
from labkit.errors import InputError, PhysicsError
from labkit.dem.limits import require_shallow
from labkit.micro.contacts import contacts_of
from labkit.micro.indicators import elastic_energy, kinetic_energy, overlap_ratio, unbalanced_force
from labkit.micro.stress import love_stress, mean_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.io.progress import log_fraction
from labkit.dem.state import grains_in_cell
from labkit.dem.time_step import critical_time_step, require_stable

VOID_RATIO_RANGE = (0.3, 1.5)
MINIMUM_GRAINS, MAXIMUM_GRAINS = 100, 10**6


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How to make a specimen. `void_ratio` is the nominal one; frictions are those of step 1.

    Raises InputError for values outside their range.
    """

    void_ratio: float
    step1_friction: float = 0.4
    step1_rolling_friction: float = 0.1
    side: float = 4e-3  # m
    seed: int = 1

    def __post_init__(self):
        low, high = VOID_RATIO_RANGE
        if not low <= self.void_ratio <= high:
            raise InputError(f"--void-ratio {self.void_ratio:g} is not possible: give {low} to {high}")
        if not 0.0 <= self.step1_friction <= 10.0:
            raise InputError(f"--step1-friction {self.step1_friction:g} is not possible: give 0 to 10")
        if not 0.0 <= self.step1_rolling_friction <= 10.0:
            raise InputError(
                f"--step1-rolling-friction {self.step1_rolling_friction:g} is not possible: give 0 to 10"
            )
        if not 0.0 < self.side <= 0.1:
            raise InputError(f"--side {self.side:g} m is not possible: give up to 0.1 m, e.g. 4e-3")
        if not 0 <= self.seed < 2**31:
            raise InputError(f"--seed {self.seed} is not possible: give a whole number from 0, below 2^31")


@dataclasses.dataclass(frozen=True)
class Equilibrium:
    """When a specimen is at rest, and how long to wait for it."""

    unbalanced_force: float
    energy_ratio: float  # kinetic over elastic
    check_interval: int = 250  # steps
    step_limit: int = 100_000


STEP1 = Equilibrium(unbalanced_force=1e-3, energy_ratio=1e-4)
STEP2 = Equilibrium(unbalanced_force=1e-4, energy_ratio=1e-5)

# The deep overlaps of a random insertion are let out with small steps, the grains stopped again and again:
# a spring system that is stopped after the time T keeps cos(omega T) of each mode, so that none grows.
RELEASE_TIME_STEP = 0.25  # of the critical one of the inserted grains
RELEASE_STEPS = 20  # between two stops
RELEASE_UNBALANCED = 0.03
RELEASE_LIMIT = 500  # stops


def side_for(grains, void_ratio, scene):
    """Side of a cube that holds about so many grains, m."""
    if not MINIMUM_GRAINS <= grains <= MAXIMUM_GRAINS:
        raise InputError(f"--grains {grains} is not possible: give {MINIMUM_GRAINS} to {MAXIMUM_GRAINS}")
    return float((grains * mean_grain_volume(scene) * (1.0 + void_ratio)) ** (1.0 / 3.0))


def mean_grain_volume(scene):
    """Mean of pi D^3/6 over the uniform distribution, m3."""
    return np.pi / 6.0 * scene.mean_diameter**3 * (1.0 + scene.diameter_spread**2)


def require_size(recipe, scene):
    """Raises InputError when the cube would hold too few or too many grains."""
    grains = recipe.side**3 / (1.0 + recipe.void_ratio) / mean_grain_volume(scene)
    if not MINIMUM_GRAINS <= grains <= MAXIMUM_GRAINS:
        low, high = (side_for(n, recipe.void_ratio, scene) for n in (MINIMUM_GRAINS, MAXIMUM_GRAINS))
        raise InputError(f"--side {recipe.side:g} m would hold {grains:.3g} grains: give {low:.2g} to {high:.2g} m")


def draw_radii(scene, solid_volume, rng):
    """Radii from the uniform distribution of diameters whose volumes add up to `solid_volume`, (grain,), m.

    Grains are drawn until less is missing than two of the largest; two equal grains fill that exactly.
    They lie within the distribution for any spread below 0.22, and are at most its mean otherwise.
    """
    low, high = (0.5 * scene.mean_diameter * (1.0 + s * scene.diameter_spread) for s in (-1.0, 1.0))
    two_largest = 2.0 * 4.0 / 3.0 * np.pi * high**3
    radii, missing = [], solid_volume
    while missing >= two_largest:
        radii.append(rng.uniform(low, high))
        missing -= 4.0 / 3.0 * np.pi * radii[-1] ** 3
    return np.array(radii + [(missing / 2.0 * 3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)] * 2)


def spatial_order(position, side, mean_diameter):
    """Indices that put grains near in space near in memory: slices, rows, cells of two diameters."""
    block = np.floor(position / side * max(1, int(side / (2 * mean_diameter)))).astype(int)
    return np.lexsort(block.T)


def insert_grains(scene, recipe):
    """A State of grains placed at random, overlaps allowed, at exactly the nominal void ratio."""
    require_size(recipe, scene)
    rng = np.random.default_rng(recipe.seed)
    radius = draw_radii(scene, recipe.side**3 / (1.0 + recipe.void_ratio), rng)
    position = rng.random((len(radius), 3)) * recipe.side
    order = spatial_order(position, recipe.side, scene.mean_diameter)
    return grains_in_cell(scene, radius[order], position[order], np.eye(3) * recipe.side, recipe.seed)


def make_specimen(scene, recipe, engine="yade", threads=1, progress=lambda fraction, text: None):
    """A State at rest at the nominal void ratio, made in the two steps of section 2.

    `progress(fraction, text)` is called as it goes. Raises PhysicsError when it does not come to rest.
    """
    inserted = insert_grains(scene.with_friction(recipe.step1_friction, recipe.step1_rolling_friction), recipe)
    return relax(inserted, scene, engine, threads, progress)


def relax(inserted, scene, engine, threads, progress):
    """A State at rest from grains inserted with the frictions of step 1; step 2 has those of `scene`."""
    machine = start_engine(engine, inserted, threads)
    machine.load(inserted.replace(time_step=RELEASE_TIME_STEP * critical_time_step(machine.state())))
    release(machine, lambda f, text: progress(0.3 * f, text))
    released = machine.state().replace(time_step=inserted.scene.time_step)
    require_stable(released)
    machine.load(opened(released))
    settle(machine, STEP1, lambda f, text: progress(0.3 + 0.3 * f, "step 1: " + text))
    machine.load(opened(machine.state().at_rest().replace(scene=scene)))
    settle(machine, STEP2, lambda f, text: progress(0.6 + 0.4 * f, "step 2: " + text))
    return machine.reload().at_rest()


def release(machine, progress):
    """Lets out the deep overlaps with the grains stopped every few steps; what is left then, settle() does."""
    still = np.zeros((3, 3))
    first = None
    for stop in range(RELEASE_LIMIT):
        machine.advance(RELEASE_STEPS, still)
        machine.stop_grains()
        if stop % 10 == 9:
            state = machine.state()
            unbalanced = unbalanced_force(state.number_of_grains, contacts_of(state))
            first = first or unbalanced
            progress(log_fraction(first, unbalanced, RELEASE_UNBALANCED), f"overlaps out, unbalanced {unbalanced:.2g}")
            if unbalanced < RELEASE_UNBALANCED:
                return


def settle(machine, target, progress):
    """Runs with the cell held until the specimen is at rest. Raises PhysicsError at the step limit."""
    still = np.zeros((3, 3))
    first = None
    for _ in range(0, target.step_limit, target.check_interval):
        machine.advance(target.check_interval, still)
        state = machine.state()
        contacts = contacts_of(state)
        if len(contacts) < state.number_of_grains:
            raise PhysicsError(
                f"the grains have come apart (coordination number {2 * len(contacts) / state.number_of_grains:.2g}): "
                "lower the void ratio or raise the step-1 friction for a specimen that carries load"
            )
        require_balanced(state, contacts)
        unbalanced = unbalanced_force(state.number_of_grains, contacts)
        elastic = elastic_energy(state.scene, state.radius, contacts)
        energy = kinetic_energy(state) / elastic if elastic > 0.0 else np.inf
        first = first or max(unbalanced, energy)
        progress(log_fraction(first, unbalanced, target.unbalanced_force), f"unbalanced {unbalanced:.2g}")
        if unbalanced < target.unbalanced_force:
            if energy < target.energy_ratio:
                return
            machine.stop_grains()  # rattlers fly on for ever: what carries load must stay at rest without them
    pressure = mean_stress(love_stress(contacts, state.radius, state.volume))
    raise PhysicsError(
        f"the specimen is not at rest after {target.step_limit} steps (unbalanced force {unbalanced:.2g}, "
        f"kinetic over elastic energy {energy:.2g}, pressure {pressure:.3g} Pa): "
        "a lower void ratio or a higher step-1 friction gives it a skeleton that carries load"
    )


def ready(specimen, engine, threads=1, guarded=True):
    """The specimen at rest with the time step of its scene, fit for a test.

    Grains that list no contacts, of another program or placed by hand, get those that the engine finds: their energy
    is in the balance from the start, and their stiffness in the stability limit. Raises InputError when they overlap
    too deeply, PhysicsError when the time step is beyond the limit and the test is `guarded`.
    """
    state = specimen.at_rest().replace(time_step=specimen.scene.time_step, engine=engine)
    if len(state.contact_grain) == 0:
        state = start_engine(engine, state, threads).state()
    require_shallow(state)
    if guarded:
        require_stable(state)
    return state


def summary(state):
    """What one wants to know of a specimen: name -> (value, unit)."""
    contacts = contacts_of(state)
    grains = state.number_of_grains
    stress = love_stress(contacts, state.radius, state.volume)
    return {
        "grains": (grains, ""),
        "contacts": (len(contacts), ""),
        "void ratio, nominal": (void_ratio_nominal(state.radius, state.volume), ""),
        "void ratio": (void_ratio(state.radius, state.volume, contacts), ""),
        "mean stress": (mean_stress(stress), "Pa"),
        "coordination number": (2 * len(contacts) / grains, ""),
        "mean overlap": (overlap_ratio(state.radius, contacts), "D"),
        "unbalanced force": (unbalanced_force(grains, contacts), ""),
        "time step": (state.time_step, "s"),
        "time step over critical": (state.time_step / critical_time_step(state), ""),
    }
