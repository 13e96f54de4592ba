"""Loading paths (section 2): strain rates that are given, stresses that are held, and when to stop.

They know no engine. A path is a frozen dataclass; adding one means writing it here and naming it in PATHS.
Directions are x, y, z; strain rates are logarithmic, 1/s, compression positive.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from labkit.errors import InputError
from labkit.dem.limits import PRESSURE_LIMIT

REVERSALS = (0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04)


@dataclasses.dataclass(frozen=True)
class Control:
    """What a servo holds: `measure` (k, 3) @ (sigma_x, sigma_y, sigma_z) at `target` (k,), Pa, by moving the cell
    with `free` (3, k) @ the k rates that it finds."""

    measure: np.ndarray
    free: np.ndarray
    target: np.ndarray


@dataclasses.dataclass(frozen=True)
class ConstantVolume:
    """CV, triaxial compression at constant volume: eps_x = eps_y = -eps_z/2 at a constant axial rate.

    rate: axial strain rate, 1/s; strain: axial strain to reach, logarithmic. Raises InputError otherwise.
    """

    rate: float = 10.0
    strain: float = 0.4

    name = "cv"
    direction = (-0.5, -0.5, 1.0)
    stops_early = False  # whether `stops` has to be asked
    record_strain = 1e-3  # axial strain between two records, unless the user says otherwise

    def __post_init__(self):
        _require_rate(self.rate)
        _require("--strain", self.strain, 0.0, 2.0)

    def turning_points(self):
        """Axial strains at which the path turns; the last one ends it."""
        return (self.strain,)

    def control(self):
        """The Control of the servo, or None when all rates are given."""
        return None

    def stops(self, pressure):
        """Whether the path ends at this mean stress, Pa, before its last strain."""
        return False


@dataclasses.dataclass(frozen=True)
class ConstantRadialStress(ConstantVolume):
    """CR, drained triaxial compression: sigma_x = sigma_y = `pressure` (Pa) at a constant axial rate."""

    pressure: float | None = None

    name = "cr"
    direction = (0.0, 0.0, 1.0)

    def __post_init__(self):
        super().__post_init__()
        _require_pressure(self.pressure)

    def control(self):
        radial = np.eye(3)[:2]
        return Control(radial, radial.T, np.full(2, self.pressure))


@dataclasses.dataclass(frozen=True)
class ConstantMeanStress(ConstantRadialStress):
    """CP, triaxial compression with the mean stress held at `pressure` (Pa) by equal radial strains."""

    name = "cp"

    def control(self):
        return Control(np.full((1, 3), 1 / 3), np.array([[1.0], [1.0], [0.0]]), np.array([self.pressure]))


@dataclasses.dataclass(frozen=True)
class CyclicConstantMeanStress(ConstantMeanStress):
    """Cyclic CP: the axial direction turns at each of `reversals`, and the path ends at the last of them."""

    reversals: tuple[float, ...] = REVERSALS
    strain: float = 0.04  # the last reversal

    name = "cyclic_cp"

    def __post_init__(self):
        object.__setattr__(self, "reversals", tuple(float(x) for x in self.reversals))
        if not self.reversals:
            raise InputError("--reversals is empty: give axial strains, e.g. 0.01,-0.01,0.02")
        steps = np.diff((0.0, *self.reversals))
        if not (np.isfinite(steps).all() and (np.abs(self.reversals) <= 2.0).all()):
            raise InputError("--reversals holds a strain that is not possible: give numbers from -2 to 2")
        if (steps == 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
            raise InputError("--reversals does not turn at each strain: go up and down in turn, e.g. 0.01,-0.01,0.02")
        object.__setattr__(self, "strain", self.reversals[-1])
        _require_rate(self.rate)
        _require_pressure(self.pressure)

    def turning_points(self):
        return self.reversals


@dataclasses.dataclass(frozen=True)
class IsotropicCompression(ConstantVolume):
    """ISOC, equal rates in the three directions until the mean stress reaches `pressure` (Pa)."""

    rate: float = 5.0
    strain: float = 0.1
    pressure: float = PRESSURE_LIMIT

    name = "isoc"
    direction = (1.0, 1.0, 1.0)
    stops_early = True
    record_strain = 1e-4

    def __post_init__(self):
        super().__post_init__()
        _require_pressure(self.pressure)

    def stops(self, pressure):
        return pressure >= self.pressure


@dataclasses.dataclass(frozen=True)
class IsotropicDilation(IsotropicCompression):
    """ISOD, equal negative rates in the three directions until the mean stress falls under `pressure` (Pa)."""

    rate: float = 2.5
    strain: float = -0.1
    pressure: float = 20e3

    name = "isod"

    def __post_init__(self):
        _require_rate(self.rate)
        if not -2.0 <= self.strain < 0.0:
            raise InputError(f"--strain {self.strain:g} is not possible for isod: give a negative number from -2")
        _require_pressure(self.pressure)

    def stops(self, pressure):
        return pressure < self.pressure


@dataclasses.dataclass(frozen=True)
class Consolidation:
    """Not a test: brings the three normal stresses to `pressure` (Pa), the start of CR and CP."""

    pressure: float
    rate: float = 5.0

    direction = (0.0, 0.0, 0.0)

    def control(self):
        return Control(np.eye(3), np.eye(3), np.full(3, self.pressure))


@dataclasses.dataclass(frozen=True)
class Biaxial:
    """Not a test: brings a plane layer to sigma_x and sigma_z (Pa), its thickness held."""

    stress_x: float
    stress_z: float
    rate: float = 5.0

    direction = (0.0, 0.0, 0.0)

    def control(self):
        plane = np.eye(3)[[0, 2]]
        return Control(plane, plane.T, np.array([self.stress_x, self.stress_z]))


PATHS = {
    path.name: path
    for path in (
        ConstantVolume, ConstantRadialStress, ConstantMeanStress,
        IsotropicCompression, IsotropicDilation, CyclicConstantMeanStress,
    )
}  # fmt: skip


def path_class(name):
    """The class of a path. Raises InputError for an unknown name."""
    if name not in PATHS:
        raise InputError(f"path {name!r} is unknown: use one of {', '.join(PATHS)}")
    return PATHS[name]


def make_path(name, pressure_now=None, **parameters):
    """The path of that name; parameters that are None take its defaults.

    `pressure_now`: what a path that holds a stress takes when no pressure is given, Pa. Raises InputError
    for an unknown path, a value that is not possible, or a parameter that the path does not have.
    """
    kind = path_class(name)
    given = {key: value for key, value in parameters.items() if value is not None}
    known = {field.name for field in dataclasses.fields(kind)}
    for key in given:
        if key not in known or (key == "strain" and kind is CyclicConstantMeanStress):
            raise InputError(f"--{key} is not a parameter of {name}: leave it out")
    if pressure_now is not None and issubclass(kind, ConstantRadialStress):
        given.setdefault("pressure", pressure_now)
    return kind(**given)


def _require(option, value, above, most):
    if not (math.isfinite(value) and above < value <= most):
        raise InputError(f"{option} {value:g} is not possible: give a number above {above:g}, at most {most:g}")


def _require_rate(rate):
    _require("--rate", rate, 0.0, 1e4)


def _require_pressure(pressure):
    if pressure is None:
        raise InputError("--pressure is missing: give it in Pa, e.g. 0.5e6")
    if not (math.isfinite(pressure) and 0.0 < pressure <= PRESSURE_LIMIT):
        raise InputError(
            f"--pressure {pressure:g} Pa is not possible: give more than 0 and at most {PRESSURE_LIMIT:g}, "
            "where the mean overlap reaches its limit of 2 %"
        )


def travelled(axial_strain):
    """Axial strain travelled until each record, shape (n,); it grows through reversals."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(axial_strain)))])
