"""Controls of the loading paths of labkit.dem.paths for the constitutive model."""

from __future__ import annotations

from typing import Any

import numpy as np

from labkit.dem.element_tests import Mixed, Oedometer
from labkit.dem.leg import Leg
from labkit.dem.loading import Path
from labkit.dem.paths import PATHS, make_path
from labkit.errors import InputError
from labkit.micro.tensors import to_six
from labkit.model.rates import Control
from labkit.parameters import with_unit

__all__ = ["Mixed", "Oedometer", "control_of", "model_path", "strain_control"]

GAIN = 100.0  # per unit of strain: the drift of a held stress falls to 1/e within 1 % of strain


def model_path(name: str, pressure: float, stop_pressure: float | None = None, **parameters: Any) -> Path:
    """Path with this name for a state at `pressure`, Pa: one of labkit.dem.paths.

    A path that holds a stress holds `pressure`; a path that stops at a stress stops at `stop_pressure`. Raises
    InputError.
    """
    kind = PATHS.require(name) if name in PATHS else None
    if kind is None:
        names = ", ".join(PATHS)
        raise InputError("is unknown", field="path", value=repr(name), allowed=f"one of {names}")
    if stop_pressure is not None:
        if kind.stops is Path.stops:
            raise InputError(f"is not a parameter of {name}: leave it out", field="stop_pressure")
        parameters = {**parameters, "pressure": with_unit(stop_pressure, "Pa")}
    return make_path(name, parameters).starting_at(pressure)


def control_of(path: Path | Leg, sign: float = 1.0, travelled: float = 0.0) -> Control:
    """Control of a path per unit of accumulated strain, at the strain `travelled`; reversed if `sign` is -1."""
    given = sign * to_six(path.flow(travelled) + path.flow(travelled).T) / 2.0
    held = path.control()
    if held is None:
        return Control(given, np.zeros((6, 0)), np.zeros((0, 6)), np.zeros(0), GAIN)
    return Control(given, np.ascontiguousarray(held.free), held.measure, held.at(travelled), GAIN)


def strain_control(strain_rate: np.ndarray) -> Control:
    """Control of a fully prescribed strain rate (3, 3), compression positive."""
    return Control(to_six(strain_rate), np.zeros((6, 0)), np.zeros((0, 6)), np.zeros(0), GAIN)
