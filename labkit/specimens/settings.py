"""Three presets, based on `labkit speed-error`; results/speed_error lists the cost and the error of each.

`standard` consists of the default values of the commands.
"""

from __future__ import annotations

import dataclasses

from labkit.grains.scene import Scene
from labkit.specimens.recipe import SIDE


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
