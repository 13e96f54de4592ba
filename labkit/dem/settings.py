"""Three sets of settings, chosen by `labkit speed-error`; results/speed_error has the cost and the error of each.

`standard` is what the commands do without options; it is made of their defaults and cannot differ from them.
"""

from __future__ import annotations

import dataclasses

from labkit.dem.scene import Scene
from labkit.dem.specimen import SIDE
from labkit.errors import InputError


@dataclasses.dataclass(frozen=True)
class Settings:
    """`side` of the cube or number of `grains`, time step rule of the Scene, axial rate over that of the path's
    default (10 1/s in shear).
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


def settings(name: str) -> Settings:
    """The Settings of that name. Raises InputError for an unknown one."""
    if name not in SETTINGS:
        allowed = f"one of {', '.join(SETTINGS)}"
        raise InputError("are unknown", field="settings", value=name, allowed=allowed, quoted=True)
    return SETTINGS[name]
