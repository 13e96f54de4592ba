"""Loading paths (section 2): measured stress in, strain rates of the cell out. They know no engine.

A path is a frozen dataclass with a `name`, an `axial_rate` and a `strain_limit`; adding one means
writing it here and naming it in PATHS.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from labkit.errors import InputError


@dataclasses.dataclass(frozen=True)
class ConstantVolume:
    """CV, triaxial compression at constant volume: eps_x = eps_y = -eps_z/2 at a constant axial rate.

    rate: axial strain rate, 1/s; strain: axial strain to reach, logarithmic. Raises InputError otherwise.
    """

    rate: float = 10.0
    strain: float = 0.4

    name = "cv"

    def __post_init__(self):
        _require("--rate", self.rate, 0.0, 1e6)
        _require("--strain", self.strain, 0.0, 2.0)

    def strain_rate(self):
        """Logarithmic strain rates in x, y, z, 1/s, compression positive."""
        return np.array([-0.5, -0.5, 1.0]) * self.rate


PATHS = {path.name: path for path in (ConstantVolume,)}


def make_path(name, **parameters):
    """The path of that name; parameters that are None take its defaults. Raises InputError."""
    if name not in PATHS:
        raise InputError(f"path {name!r} is unknown: use one of {', '.join(PATHS)}")
    return PATHS[name](**{key: value for key, value in parameters.items() if value is not None})


def velocity_gradient(strain_rate, time_step):
    """The velocity gradient L (3, 3), 1/s, that makes 1 + L dt = exp(-rate dt) in every step.

    The cell then follows the logarithmic strains exactly, and a rate without volume keeps the volume.
    """
    return np.diag(np.expm1(-np.asarray(strain_rate) * time_step) / time_step)


def _require(option, value, above, most):
    if not (math.isfinite(value) and above < value <= most):
        raise InputError(f"{option} {value:g} is not possible: give a number above {above:g}, at most {most:g}")
