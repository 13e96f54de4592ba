"""Specimens of a given density: e_min and e_max, and relative densities.

For e_min and e_max, a gas of grains is compressed isotropically to `pressure` (labkit.specimens.compression), without
friction for e_min and with the friction and rolling friction of the scene for e_max. The specimen then comes to rest
with the friction of the scene. A friction higher than this during the compression yields denser specimens, because they
collapse when the friction is lowered (results/density). Void ratios are nominal. The limits depend on the protocol:
state it with every relative density.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np
import pandas
from scipy import stats

from labkit.engines import Device
from labkit.engines.base import Progress
from labkit.errors import PhysicsError, require_type
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.parameters import Parameter, warn_of_doubt
from labkit.simulation.api import make_specimen, progress_function
from labkit.specimens.bisection import compression_recipe
from labkit.specimens.recipe import Recipe

PRESSURE = 100e3  # pressure of the limits, Pa
LOOSEST = 3.0  # no soil of rigid grains has a larger void ratio


@dataclasses.dataclass(frozen=True, eq=False)
class DensityLimits:
    """Void ratios e_min and e_max of several specimens, shape (seed,), at a pressure in Pa.

    `left_out` says why specimens are missing, one sentence for each.
    """

    e_min: np.ndarray
    e_max: np.ndarray
    pressure: float
    left_out: tuple[str, ...] = ()

    def relative_density(self, void_ratio: float | str) -> float:
        """Return (e_max - e)/(e_max - e_min) with the means of e_max and e_min. Raises InputError above e = 3."""
        e: float = Parameter("void_ratio", low=0.0, high=LOOSEST).read(void_ratio)
        low, high = float(self.e_min.mean()), float(self.e_max.mean())
        return (high - e) / (high - low)

    def interval(self, relative_density: float) -> float:
        """Return the half-width of the 95 % interval of a relative density, from the scatter of e_min and e_max."""
        gap = float(self.e_max.mean() - self.e_min.mean())
        return float(
            np.hypot((1.0 - relative_density) * half_width(self.e_max), relative_density * half_width(self.e_min)) / gap
        )

    def table(self, void_ratios: Mapping[str, float]) -> pandas.DataFrame:
        """Tabulate e_min, e_max and the specimens (name -> nominal void ratio), with half-widths of 95 % intervals."""
        rows: list[dict[str, object]] = [
            {"name": name, "void_ratio": values.mean(), "+-": half_width(values), "relative_density": density}
            for name, values, density in (("e_min", self.e_min, 1.0), ("e_max", self.e_max, 0.0))
        ]
        for name, void_ratio in void_ratios.items():
            density = self.relative_density(void_ratio)
            columns = {"relative_density": density, "relative_density +-": self.interval(density)}
            rows.append({"name": name, "void_ratio": void_ratio, **columns})
        return pandas.DataFrame(rows)

    def void_ratio(self, relative_density: float | str) -> float:
        """Return the void ratio at a relative density, a fraction or text such as `60 %`.

        Raises InputError outside -0.5 to 1.5: a material may be denser or looser than the protocol makes it.
        """
        density: float = Parameter("relative_density", low=-0.5, high=1.5).read(relative_density)
        low, high = float(self.e_min.mean()), float(self.e_max.mean())
        return high - density * (high - low)


def half_width(values: np.ndarray) -> float:
    """Return the half-width of the 95 % confidence interval of a mean, from Student's t; NaN for a single value."""
    if values.size < 2:
        return float("nan")
    return float(stats.t.ppf(0.975, values.size - 1) * values.std(ddof=1) / np.sqrt(values.size))


def density_limits(
    scene: Scene,
    grains: int = 1000,
    *,
    engine: str | Device = "fused",
    progress: bool | Progress = True,
    seeds: int | Iterable[int] = 3,
    pressure: float | str = PRESSURE,
) -> DensityLimits:
    """Measure e_min and e_max of a material on specimens with the seeds 1 to `seeds`, or with these seeds.

    Specimens that fail are left out. Raises InputError for invalid arguments, and PhysicsError if every specimen for
    e_min, or every specimen for e_max, fails.
    """
    require_type(scene, Scene, "scene", "labkit.Scene()")
    numbers = list(range(1, seeds + 1)) if isinstance(seeds, (int, np.integer)) else list(seeds)
    show = progress_function(progress, "density limits")
    parameter = Parameter("pressure", unit="Pa")
    at: float = parameter.read(pressure)
    warn_of_doubt(parameter.doubt(pressure))
    left_out: list[str] = []
    measured: dict[float, list[float]] = {0.0: [], 1.0: []}
    for share, ratios in measured.items():
        for seed in numbers:
            done = len(measured[0.0]) + len(measured[1.0])
            name = f"{'e_max' if share else 'e_min'}, seed {seed}"
            show(done / (2 * len(numbers)), name)
            recipe = compression_recipe(share, scene, at, grains, seed)
            try:
                specimen = make_specimen(recipe, scene, engine=engine, progress=False)
            except PhysicsError as error:
                left_out.append(f"{name} is left out: {error}")
                continue
            ratios.append(void_ratio_nominal(specimen.snapshot()))
        if not ratios:
            raise PhysicsError("; ".join(left_out))
    low, high = (float(np.mean(ratios)) for ratios in measured.values())
    if low >= high:
        raise PhysicsError(
            f"e_max {high:.4f} is not above e_min {low:.4f}: give the material friction, or more grains or specimens"
        )
    return DensityLimits(np.array(measured[0.0]), np.array(measured[1.0]), at, tuple(left_out))


def specimen_at(
    scene: Scene,
    void_ratio: float,
    *,
    pressure: float | str,
    engine: str | Device = "fused",
    progress: bool | Progress = True,
    grains: int = 1000,
    seed: int = 1,
    tolerance: float = Recipe.tolerance,
) -> State:
    """Make a specimen with this nominal void ratio at this pressure, finding the friction of step 1 by bisection.

    The same as make_specimen with Recipe(void_ratio, pressure=pressure, preparation="bisection"): the friction and
    rolling friction during the compression are the scene's values times the same factor. `pressure` is in Pa, or text
    with a unit. Raises PhysicsError if no factor gives the void ratio within `tolerance`; specimens of a few hundred
    grains scatter by more than the default, 0.002.
    """
    require_type(scene, Scene, "scene", "labkit.Scene()")
    recipe = Recipe(
        void_ratio, grains=grains, seed=seed, preparation="bisection", pressure=pressure, tolerance=tolerance
    )
    return make_specimen(recipe, scene, engine=engine, progress=progress)
