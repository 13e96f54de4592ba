"""Recipe: how to make a specimen."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from labkit.bodies.shapes import Shape, Sphere, clumps_in_place_of, measure_shape, read_shape
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.parameters import Number, check_parameters, parameter
from labkit.paths.standard import CELLS

MINIMUM_GRAINS, MAXIMUM_GRAINS = 100, 10**6
SIDE = 4e-3  # side of the cube in the paper, m
BEFORE = "fixed"  # the cell of a recipe that does not say it, because it is older
FABRICS = ("isotropic", "deposited", "pre-compressed", "pre-extended")
USUAL_VOID_RATIO = 0.7  # determines the size of a specimen compressed to a pressure


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How to make a specimen: `void_ratio` is nominal; the friction coefficients apply to relaxation step 1.

    The size is given by `side` or by the approximate number of `grains`; the default is the paper's cube of 4 mm. A
    cell with an `aspect` other than 1 has the base `side` x `side`. `preparation = "insertion"` is the method of the
    paper. `preparation = "compression"` compresses a gas of grains isotropically (labkit.specimens.compression), with
    the friction of step 1, to the void ratio. If `pressure` is given, the gas is compressed to this pressure: leave the
    void ratio out, which is a result; if it is given, it only determines the size. `preparation = "bisection"` reaches
    both the void ratio and the `pressure`: it searches for the friction of step 1 that leads to them, as a fraction of
    the friction of the scene. If the `cell` is free, the stress of the specimen is isotropic; if it is fixed, as in the
    paper, the cell keeps its shape and the specimen some shear stresses. A `fabric` other than isotropic makes a
    specimen anisotropic at this isotropic stress (labkit.specimens.fabric).
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
    fabric: str = parameter(
        "isotropic",
        choices=FABRICS,
        help="contact fabric of a specimen at a pressure. deposited: the gas is compressed along z only, like grains "
        "that settle; pre-compressed, pre-extended: sheared by 5 % along z at this mean stress, and back",
    )
    seed: Number[int] = parameter(1, low=0, high=2**31 - 1, help="random seed of the insertion")
    shape: str = parameter(
        "sphere", help="shape of the grains, such as `rod aspect_ratio=1.5`, or several, separated by commas"
    )
    size_classes: Number[int | None] = parameter(
        None, low=1, high=64, kind=int, help="number of different diameters (default: no two are equal)"
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
        if all(isinstance(shape, Sphere) for shape in self.shapes):
            object.__setattr__(self, "shape", Recipe.shape)
        if self.side is not None and self.grains is not None:
            raise InputError("and a number of grains are both given: omit one of them", field="side", value=self.side)
        if self.pressure is not None and self.preparation == "insertion":
            allowed = "preparation = compression, or preparation = bisection to reach both, or no pressure"
            raise InputError("needs another preparation", field="pressure", value=self.pressure, allowed=allowed)
        if self.preparation != "bisection" and self.tolerance != Recipe.tolerance:
            raise InputError("needs preparation = bisection: leave it out", field="tolerance", value=self.tolerance)
        if self.preparation == "bisection" and self.pressure is None:
            raise InputError("is missing", field="pressure", allowed="the pressure at which to reach the void ratio")
        if self.fabric != FABRICS[0] and self.pressure is None:
            allowed = "a pressure with preparation = compression or bisection, or fabric = isotropic"
            raise InputError("needs a pressure", field="fabric", value=self.fabric, allowed=allowed)
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

    def missed(self, reached: float) -> str:
        """Say that a specimen compressed to a pressure has another void ratio than the recipe; empty if it has not.

        Args:
            reached: Nominal void ratio of the specimen.
        """
        if self.preparation != "compression" or self.pressure is None or self.void_ratio is None:
            return ""
        if abs(reached - self.void_ratio) <= Recipe.tolerance:
            return ""
        return (
            f"compressed to the pressure, the specimen has a nominal void ratio of {reached:.4f}, not "
            f"{self.void_ratio:.4g}, which only sets its size: leave the void ratio out, or "
            "give preparation = bisection"
        )

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
        """Return the recipe as JSON text, as stored in files."""
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
        return None if recipe is None or recipe.pressure is not None else recipe.void_ratio

    @classmethod
    def from_json(cls, text: str) -> Recipe | None:
        """Return the recipe from the JSON text of a file; None for other text, as in a file of imported grains."""
        try:
            return cls(**{"cell": BEFORE, **json.loads(text)})
        except (TypeError, ValueError):
            return None


def side_for(grains: float, void_ratio: float, scene: Scene) -> float:
    """Return the side of a cube that holds approximately the given number of grains, m."""
    return float((grains * mean_grain_volume(scene) * (1.0 + void_ratio)) ** (1.0 / 3.0))


def mean_grain_volume(scene: Scene) -> float:
    """Return the mean of pi D^3/6 over the distribution of diameters by number, m3."""
    if scene.grading is not None:
        return scene.sizes.mean_volume
    return np.pi / 6.0 * scene.mean_diameter**3 * (1.0 + scene.diameter_spread**2)


@dataclasses.dataclass(frozen=True)
class Settings:
    """A preset.

    Args:
        side: Side of the specimen, m, unless `grains` is given.
        grains: Approximate number of grains.
        time_step_factor: time_step_factor of the Scene.
        rate_factor: Axial strain rate divided by the default of the path (labkit.paths.rates.default_rate).
    """

    side: float | None = None  # m
    grains: int | None = None
    time_step_factor: float = Scene.time_step_factor
    rate_factor: float = 1.0


SETTINGS = {
    "quick": Settings(grains=2000, time_step_factor=0.3, rate_factor=4.0),
    "standard": Settings(side=SIDE),
    "reference": Settings(side=SIDE, time_step_factor=0.1, rate_factor=0.5),
}
