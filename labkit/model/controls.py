"""Controls of the loading paths of labkit.paths.standard for the constitutive model."""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import to_six
from labkit.model.rates import PointControl
from labkit.parameters import parameters_of
from labkit.paths.element_tests import Mixed, Oedometer
from labkit.paths.path import Path
from labkit.paths.registry import PATHS, make_path
from labkit.paths.step import Step

__all__ = ["Mixed", "Oedometer", "control_of", "model_path", "strain_control"]

NOTHING_HELD = np.zeros((6, 0)), np.zeros((0, 6)), np.zeros(0)
GAIN = 100.0  # per unit of strain: the drift of a held stress falls to 1/e within 1 % strain


def model_path(name: str, pressure: float, stop_pressure: float | None = None, **parameters: object) -> Path:
    """Return the loading path that `name` names (labkit.paths.standard), starting from a mean stress.

    Raises InputError for an unknown path or an invalid parameter.

    Args:
        name: Name of the path.
        pressure: Mean stress of the initial state, Pa; also the stress to hold, if the path holds one.
        stop_pressure: Mean stress at which to stop, Pa, if the path ends at a stress.
        parameters: Other parameters of the path.
    """
    kind = PATHS.require(name) if name in PATHS else None
    if kind is None:
        names = ", ".join(PATHS)
        raise InputError("is unknown", field="path", value=repr(name), allowed=f"one of {names}")
    if stop_pressure is not None:
        if not stops_at_pressure(kind):
            raise InputError(f"is not a parameter of {name}: leave it out", field="stop_pressure")
        parameters = {**parameters, "pressure": stop_pressure}
    return make_path(name, parameters).starting_at(pressure)


def stops_at_pressure(kind: type[Path]) -> bool:
    """Return True if the parameter `pressure` of a path is the mean stress at which the path ends."""
    return "pressure" in parameters_of(kind) and kind.start_pressure is Path.start_pressure


def control_of(step: Step, accumulated: float = 0.0) -> PointControl:
    """Return the control of a step of a path, per unit of accumulated strain."""
    rates, held = step.rates(accumulated), step.held
    water = 0.0 if held is None or held.water is None else held.water.stiffness
    prescribed = np.array([*to_six(rates + rates.T) / 2.0, water])
    if held is None:
        return PointControl(prescribed, *NOTHING_HELD, GAIN)
    return PointControl(prescribed, np.ascontiguousarray(held.free), held.measure, held.at(accumulated), GAIN)


def strain_control(strain_rate: np.ndarray) -> PointControl:
    """Return the control of a fully prescribed strain rate (3, 3), compression positive."""
    return PointControl(np.array([*to_six(strain_rate), 0.0]), *NOTHING_HELD, GAIN)
