"""The strain rate of a path; a missing rate gets its default when the path is applied to a specimen."""

from __future__ import annotations

import dataclasses
import math
from typing import TypeVar

from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.parameters import parameters_of
from labkit.paths.path import Path

AnyPath = TypeVar("AnyPath", bound=Path)


def default_rate(kind: type[Path], scene: Scene) -> float:
    """Return the default axial strain rate of a path for the grains of a scene, 1/s.

    At a given mean stress p, the inertial number I = |D'| D sqrt(rho/p) (section 2, D' the strain rate tensor) is then
    the same as for the grains of Table 1, D0 = 0.17 mm and rho0 = 2650 kg/m3:

        rate = standard_rate (D0/D) sqrt(rho0/rho)

    For Table 1 the rate is exactly `standard_rate`. Young's modulus does not enter, because I does not depend on it. If
    the field `rate` of a path has a number as its default, this number is returned.
    """
    default = parameters_of(kind)["rate"].default
    if default is not None:
        return float(default)
    return kind.standard_rate * (Scene.mean_diameter / scene.mean_diameter) * math.sqrt(Scene.density / scene.density)


def at_rate(path: AnyPath, rate: float) -> AnyPath:
    """Return a copy of a path with the axial strain rate `rate`, 1/s."""
    return dataclasses.replace(path, rate=rate)


def on_grains(path: AnyPath, scene: Scene) -> AnyPath:
    """Return the path; if it has no rate, with the default rate for the grains of a scene."""
    return path if path.rate is not None else at_rate(path, default_rate(type(path), scene))


def rate_of(path: Path) -> float:
    """Return the axial strain rate of a path, 1/s. Raises InputError while it is None (see `on_grains`)."""
    if path.rate is None:
        raise InputError("is missing: give a rate, or create the path with `on_grains`", field="rate")
    return path.rate
