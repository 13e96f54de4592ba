"""Specimens (section 2): grains inserted at random with overlap, relaxed in two steps, and their shear stresses."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from labkit.bodies.shapes import Shape, clumps_in_place_of, measure_shape, read_shape
from labkit.engines.base import Engine, Progress, reload, silent
from labkit.engines.device import Device
from labkit.errors import InputError, PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.time_step import critical_time_step, require_stable
from labkit.io.progress import log_fraction
from labkit.micro.cells import relative_width
from labkit.micro.indicators import elastic_energy, overlap_ratio, unbalanced_force
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import equivalent_stress, mean_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.named import Named
from labkit.parameters import Number, check_parameters, parameter, restore
from labkit.paths.standard import CELLS
from labkit.records.energy import kinetic_energy, open_ledger, require_balanced
from labkit.specimens.consolidation import level

MINIMUM_GRAINS, MAXIMUM_GRAINS = 100, 10**6
SIDE = 4e-3  # side of the cube in the paper, m
BEFORE = "fixed"  # the cell of a recipe that does not say it, because it is older
USUAL_VOID_RATIO = 0.7  # determines the size of a specimen compressed to a pressure
FIRST, SECOND = "step 1 of 2, friction of the preparation", "step 2 of 2, friction of the tests"


@dataclasses.dataclass(frozen=True)
class Recipe(Named):
    """How to make a specimen: `void_ratio` is nominal; the friction coefficients apply to relaxation step 1.

    The size is given by `side` or by the approximate number of `grains`; the default is the paper's cube of 4 mm. A
    cell with an `aspect` other than 1 has the base `side` x `side`. `preparation = "insertion"` is the method of the
    paper. `preparation = "compression"` compresses a gas of grains isotropically (labkit.specimens.compression), with
    the friction of step 1, to the void ratio. If `pressure` is given, the gas is compressed to this pressure: leave the
    void ratio out, which is a result; if it is given, it only determines the size. `preparation = "bisection"` reaches
    both the void ratio and the `pressure`: it searches for the friction of step 1 that leads to them, as a fraction of
    the friction of the scene. If the `cell` is free, the stress of the specimen is isotropic; if it is fixed, as in the
    paper, the cell keeps its shape and the specimen some shear stresses.
    Raises InputError for values outside their ranges.
    """

    void_ratio: float = parameter(
        None,
        low=0.3,
        high=1.5,
        kind=float,
        help="target void ratio, not corrected for overlaps, e.g. 0.67; not with compression to a pressure",
    )
    step1_friction: Number[float] = parameter(
        0.15, low=0.0, high=10.0, help="friction coefficient mu of step 1; determines the pressure"
    )
    step1_rolling_friction: Number[float] = parameter(
        0.1, low=0.0, high=10.0, help="rolling friction coefficient mu_r of step 1"
    )
    side: Number[float | None] = parameter(None, unit="m", above=0.0, high=0.1, help="side of the cube (default: 4 mm)")
    grains: Number[int | None] = parameter(
        None, low=MINIMUM_GRAINS, high=MAXIMUM_GRAINS, kind=int, help="approximate number of grains, instead of a side"
    )
    aspect: Number[float] = parameter(1.0, low=0.2, high=10.0, help="height of the cell divided by its side")
    preparation: str = parameter(
        "insertion",
        choices=("insertion", "compression", "bisection"),
        help="insertion with overlap, compression of a gas with the friction of step 1, or bisection, which searches "
        "for the friction of step 1 that gives the void ratio at the pressure",
    )
    pressure: Number[float | None] = parameter(
        None,
        unit="Pa",
        above=0.0,
        high=1e12,
        help="pressure to reach: with compression instead of the void ratio, with bisection beside it",
    )
    tolerance: Number[float] = parameter(0.002, above=0.0, high=0.1, help="with bisection: tolerance of the void ratio")
    seed: Number[int] = parameter(1, low=0, high=2**31 - 1, help="random seed of the insertion")
    shape: str = parameter(
        "sphere", help="shape of the grains, such as `rod aspect_ratio=1.5`, or several, separated by commas"
    )
    size_classes: Number[int | None] = parameter(
        None,
        low=1,
        high=64,
        kind=int,
        help="number of different diameters, as LAMMPS needs (default: no two are equal)",
    )
    cell: str = parameter(
        "free",
        choices=CELLS,
        help="free: the cell shears slightly at the end until the stress is isotropic; fixed: it keeps its shape, and "
        "the specimen shear stresses, as in the paper",
    )

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)
        if self.void_ratio is None and (self.pressure is None or self.preparation != "compression"):
            raise InputError("is missing", field="void_ratio", allowed="one, e.g. 0.67")
        for shape in self.shapes:
            measure_shape(shape)
        if self.side is not None and self.grains is not None:
            raise InputError("and a number of grains are both given: omit one of them", field="side", value=self.side)
        if self.pressure is not None and self.preparation == "insertion":
            allowed = (
                "preparation = bisection, which reaches both, or compression; or no pressure, and consolidate after"
            )
            raise InputError("needs another preparation", field="pressure", value=self.pressure, allowed=allowed)
        if self.preparation != "bisection" and self.tolerance != Recipe.tolerance:
            raise InputError("needs preparation = bisection: leave it out", field="tolerance", value=self.tolerance)
        if self.preparation == "bisection" and self.pressure is None:
            raise InputError("is missing", field="pressure", allowed="the pressure at which to reach the void ratio")
        for name in ("step1_friction", "step1_rolling_friction") if self.preparation == "bisection" else ():
            if (value := getattr(self, name)) != getattr(Recipe, name):
                raise InputError("is what the bisection searches for: leave it out", field=name, value=value)

    @property
    def size_ratio(self) -> float:
        """The void ratio that determines the size."""
        return USUAL_VOID_RATIO if self.void_ratio is None else self.void_ratio

    def side_of(self, scene: Scene) -> float:
        """Return the side of the base for grains of this scene, m. Raises InputError for too few or too many grains."""
        if self.grains is not None:
            return side_for(self.grains / self.aspect, self.size_ratio, scene)
        side = SIDE if self.side is None else self.side
        grains = side**3 * self.aspect / (1.0 + self.size_ratio) / mean_grain_volume(scene)
        if not MINIMUM_GRAINS <= grains <= MAXIMUM_GRAINS:
            low, high = (side_for(n / self.aspect, self.size_ratio, scene) for n in (MINIMUM_GRAINS, MAXIMUM_GRAINS))
            allowed = f"{1.01 * low:.3g} to {0.99 * high:.3g} m"
            raise InputError(f"m would hold {grains:.3g} grains", field="side", value=side, allowed=allowed)
        return side

    def expected_grains(self, scene: Scene) -> int:
        """Return the approximate number of grains."""
        solid = self.side_of(scene) ** 3 * self.aspect / (1.0 + self.size_ratio)
        return self.grains or round(solid / mean_grain_volume(scene))

    def expected_spheres(self, scene: Scene) -> int:
        """Return the approximate number of spheres, which clumps have more of than grains."""
        return round(self.expected_grains(scene) * np.mean([len(measure_shape(each).radius) for each in self.shapes]))

    @property
    def shapes(self) -> list[Shape]:
        """Shapes of the grains. Raises InputError."""
        return [read_shape(text) for text in self.shape.split(",")]

    def give_shapes(self, inserted: State) -> State:
        """Return the inserted spheres, or the clumps that replace them if the recipe has shapes."""
        if self.shape == Recipe.shape:
            return inserted
        return inserted.replace(**clumps_in_place_of(inserted.radius, inserted.position, self.shapes, self.seed))

    def to_json(self) -> str:
        """Return the recipe as JSON text, for files."""
        return json.dumps(dataclasses.asdict(self))

    @staticmethod
    def cell_of(state: State) -> str:
        """Return whether the cell of a specimen was free or fixed when it was made; free if no recipe says it."""
        recipe = Recipe.from_json(state.recipe)
        return Recipe.cell if recipe is None else recipe.cell

    @classmethod
    def made_at(cls, text: str) -> float | None:
        """Return the nominal void ratio to which the recipe in JSON text leads; None if it does not say one."""
        recipe = cls.from_json(text)
        aims = recipe is not None and not (recipe.preparation == "compression" and recipe.pressure is not None)
        return recipe.void_ratio if recipe is not None and aims else None

    @classmethod
    def from_json(cls, text: str) -> Recipe | None:
        """Return the recipe from the JSON text of a file; None for other text, as in a file of imported grains."""
        try:
            return restore(cls, {"cell": BEFORE, **json.loads(text)})
        except (TypeError, ValueError):
            return None


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


def side_for(grains: float, void_ratio: float, scene: Scene) -> float:
    """Return the side of a cube that holds approximately the given number of grains, m."""
    return float((grains * mean_grain_volume(scene) * (1.0 + void_ratio)) ** (1.0 / 3.0))


def mean_grain_volume(scene: Scene) -> float:
    """Return the mean of pi D^3/6 over the distribution of diameters by number, m3."""
    if scene.grading is not None:
        return scene.sizes.mean_volume
    return np.pi / 6.0 * scene.mean_diameter**3 * (1.0 + scene.diameter_spread**2)


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
    made = relax(recipe.give_shapes(inserted), scene, device, lambda f, text: progress(share * f, text))
    if recipe.cell == "free":
        made = level(made, STEP2.unbalanced_force, device, lambda f, text: progress(0.8 + 0.2 * f, text))
    return made.replace(recipe=recipe.to_json())


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
    if np.isfinite(limit):  # finite only if the specimen has contacts
        values["time step/critical time step"] = state.time_step / limit, ""
    return values
