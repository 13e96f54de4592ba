"""Controls of the loading paths of labkit.dem.paths, and two paths for the model only: oedometer and mixed control."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from labkit.dem.paths import PATHS, Path, make_path
from labkit.errors import InputError
from labkit.model.rates import Control
from labkit.model.tensors import require_symmetric, to_six
from labkit.parameters import parameter, with_unit

GAIN = 100.0  # per unit of strain: the drift of a held stress falls to 1/e within 1 % of strain


@dataclasses.dataclass(frozen=True)
class Oedometer(Path):
    """One-dimensional compression: eps_x = eps_y = 0."""

    strain: float = parameter(0.1, above=0.0, high=2.0, help="axial strain to reach, logarithmic")

    name = "oedometer"
    direction = (0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Mixed:
    """Any mixed control: six conditions on strain rates and stresses, with constant coefficients.

    `strain_rate` (3, 3) per unit of accumulated strain is the prescribed part; along `free`, k symmetric tensors
    (k, 3, 3), the strain rate follows from the condition that `measured` : sigma, with k tensors (k, 3, 3), equals
    `target` (k,), Pa:

        D = strain_rate + sum_j x_j free_j      measured_i : sigma = target_i

    `strain`: accumulated strain at which the path ends. Raises InputError for tensors that are not symmetric, or shapes
    that do not match.
    """

    strain_rate: np.ndarray
    free: np.ndarray
    measured: np.ndarray
    target: np.ndarray
    strain: float = 0.1
    record_strain: float = 1e-3
    rate: float = 1.0

    name = "mixed"
    shear = False
    stops_early = False

    def __post_init__(self) -> None:
        """Check and convert the fields. Raises InputError."""
        require_symmetric("strain_rate", self.strain_rate)
        target = np.atleast_1d(np.asarray(self.target, dtype=float))
        for name in ("free", "measured"):
            tensors = np.asarray(getattr(self, name), dtype=float).reshape(-1, 3, 3)
            object.__setattr__(self, name, require_symmetric(name, tensors))
            if len(tensors) != target.size:
                raise InputError(
                    f"{name} has {len(tensors)} tensors for {target.size} targets: give one tensor per target"
                )
        if not np.isfinite(target).all():
            raise InputError("target has a value that is not finite: give stresses in Pa")
        object.__setattr__(self, "target", target)
        if not (np.isfinite(self.strain) and self.strain > 0.0 and self.record_strain > 0.0):
            raise InputError(f"strain {self.strain:g} is not possible: give a positive number")

    def turning_points(self) -> tuple[float, ...]:
        """As for a Path: the accumulated strain at which it ends."""
        return (self.strain,)

    def parameters(self) -> dict[str, Any]:
        """Fields as lists and numbers, for files."""
        return {
            name: np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
            for name, value in dataclasses.asdict(self).items()
        }

    def stops(self, pressure: float) -> bool:
        """As for a Path: False, it never stops early."""
        return False


def model_path(name: str, pressure: float, stop_pressure: float | None = None, **parameters: Any) -> Path:
    """Path with this name for a state at `pressure`, Pa: a path of labkit.dem.paths, or the oedometer.

    A path that holds a stress holds `pressure`; a path that stops at a stress stops at `stop_pressure`. Raises
    InputError.
    """
    if name == Oedometer.name:
        for key, value in {**parameters, "stop_pressure": stop_pressure}.items():
            if value is not None and key not in ("strain", "rate"):
                raise InputError(f"is not a parameter of {name}: leave it out", field=key)
        return Oedometer(**{key: value for key, value in parameters.items() if value is not None})
    kind = PATHS.require(name) if name in PATHS else None
    if kind is None:
        names = ", ".join((*PATHS, Oedometer.name))
        raise InputError("is unknown", field="path", value=repr(name), allowed=f"one of {names}")
    if stop_pressure is not None:
        if kind.stops is Path.stops:
            raise InputError(f"is not a parameter of {name}: leave it out", field="stop_pressure")
        parameters = {**parameters, "pressure": with_unit(stop_pressure, "Pa")}
    return make_path(name, parameters).starting_at(pressure)


def control_of(path: Path | Mixed, sign: float = 1.0) -> Control:
    """Control of a path per unit of axial strain (of accumulated strain for Mixed); reversed if `sign` is -1."""
    if isinstance(path, Mixed):
        return Control(
            sign * to_six(path.strain_rate),
            np.ascontiguousarray(to_six(path.free).T),
            to_six(path.measured),
            path.target,
            GAIN,
        )
    given = np.zeros(6)
    given[:3] = sign * np.array(path.direction)
    held = path.control()
    k = 0 if held is None else len(held.target)
    free, measure, target = np.zeros((6, k)), np.zeros((k, 6)), np.zeros(k)
    if held is not None:
        free[:3], measure[:, :3], target[:] = held.free, held.measure, held.target
    return Control(given, free, measure, target, GAIN)


def strain_control(strain_rate: np.ndarray) -> Control:
    """Control of a fully prescribed strain rate (3, 3), compression positive."""
    return Control(to_six(strain_rate), np.zeros((6, 0)), np.zeros((0, 6)), np.zeros(0), GAIN)
