"""Loading paths of section 2 and their registry; labkit.dem.loading defines their interface."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from labkit.dem.control import Control
from labkit.dem.loading import Held, Path, StressPath, rate_parameter, require_direction
from labkit.dem.strain_measures import VOLUMETRIC, StrainMeasure
from labkit.errors import InputError, nearest
from labkit.extensions import Registry
from labkit.micro.stress import mean_stress
from labkit.parameters import parameter, parameters_of, restored

PRESSURE_LIMIT = 3e6  # Pa: where the mean overlap of the grains of Table 1 reaches 2 %
REVERSALS = (0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04)


@dataclasses.dataclass(frozen=True)
class ConstantVolume(Path):
    """CV, triaxial compression at constant volume: eps_x = eps_y = -eps_z/2 at a constant axial rate."""

    name = "cv"
    direction = (-0.5, -0.5, 1.0)
    shear = True

    def held(self) -> tuple[Held, ...]:
        return (Held("volume", "volume"),)


@dataclasses.dataclass(frozen=True)
class ConstantRadialStress(StressPath):
    """CR, drained triaxial compression: sigma_x = sigma_y = `pressure` at a constant axial rate."""

    name = "cr"
    shear = True
    holds = "radial stress"
    line_style = "--"

    def control(self) -> Control:
        radial = np.eye(3)[:2]
        return Control(radial, radial.T, np.full(2, self.held_pressure))


@dataclasses.dataclass(frozen=True)
class ConstantMeanStress(StressPath):
    """CP, triaxial compression with the mean stress held at `pressure` by equal radial strains."""

    name = "cp"
    shear = True
    holds = "mean stress"
    line_style = ":"

    def control(self) -> Control:
        return Control(np.full((1, 3), 1 / 3), np.array([[1.0], [1.0], [0.0]]), np.array([self.held_pressure]))


@dataclasses.dataclass(frozen=True)
class CyclicConstantMeanStress(ConstantMeanStress):
    """Cyclic CP: the axial strain rate reverses at each of `reversals`, and the path ends at the last of them."""

    strain: float = dataclasses.field(init=False, default=0.04)  # the last reversal
    reversals: tuple[float, ...] = parameter(
        REVERSALS,
        help="axial strains at which the path reverses; it ends at the last one. "
        "Write --reversals=-0.01,... if the first is negative",
    )

    name = "cyclic_cp"
    shear = False
    line_style = "-."

    def __post_init__(self) -> None:
        """Check that the path reverses at every one of `reversals`. Raises InputError."""
        super().__post_init__()
        known = parameters_of(type(self))["reversals"]
        if not self.reversals:
            raise InputError("is empty", field="reversals", allowed="axial strains, e.g. 0.01,-0.01,0.02")
        steps = np.diff((0.0, *self.reversals))
        if not (np.isfinite(steps).all() and (np.abs(self.reversals) <= 2.0).all()):
            raise known.error(self.reversals, "contains a strain that is out of range", "numbers from -2 to 2")
        if (steps == 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
            raise known.error(
                self.reversals,
                "does not reverse at each strain",
                "strains that alternately increase and decrease, e.g. 0.01,-0.01,0.02",
            )
        object.__setattr__(self, "strain", self.reversals[-1])

    def turning_points(self) -> tuple[float, ...]:
        return self.reversals


_EQUAL = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, -1.0]])


@dataclasses.dataclass(frozen=True)
class IsotropicCompression(Path):
    """ISOC, equal rates in the three directions until the mean stress reaches `pressure`."""

    rate: float | None = rate_parameter("strain rate in each direction", 5.0)
    strain: float = parameter(0.1, above=0.0, high=2.0, help="maximum strain")
    pressure: float = parameter(
        PRESSURE_LIMIT, unit="Pa", above=0.0, high=1e12, help="mean stress at which the test stops"
    )

    name = "isoc"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 5.0
    record_strain = 1e-4

    def strain_measure(self) -> StrainMeasure:
        return VOLUMETRIC

    def stops(self, pressure: float) -> bool:
        return pressure >= self.pressure

    def why_ended(self, record: Mapping[str, Any], leg: int) -> str:
        return _short_of(self, record)

    def held(self) -> tuple[Held, ...]:
        return (Held("three equal strains", "strain", _EQUAL),)


@dataclasses.dataclass(frozen=True)
class IsotropicDilation(Path):
    """ISOD, equal negative rates in the three directions until the mean stress falls below `pressure`."""

    rate: float | None = rate_parameter("strain rate in each direction", 2.5)
    strain: float = parameter(-0.1, low=-2.0, high=-1e-9, help="maximum dilation, a negative strain")
    pressure: float = parameter(20e3, unit="Pa", above=0.0, high=1e12, help="mean stress below which the test stops")

    name = "isod"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 2.5
    record_strain = 1e-4

    def strain_measure(self) -> StrainMeasure:
        return VOLUMETRIC

    def stops(self, pressure: float) -> bool:
        return pressure < self.pressure

    def why_ended(self, record: Mapping[str, Any], leg: int) -> str:
        return _short_of(self, record)

    def held(self) -> tuple[Held, ...]:
        return (Held("three equal strains", "strain", _EQUAL),)


def _short_of(path: IsotropicCompression | IsotropicDilation, record: Mapping[str, Any]) -> str:
    """The sentence for a path that ended at its `strain` before it reached its `pressure`."""
    p = float(mean_stress(record["stress"]))
    if path.stops(p):
        return ""
    return (
        f"the strain limit {path.strain:g} was reached at a mean stress of {p / 1e3:.4g} kPa, before the stress of "
        f"{path.pressure / 1e3:.4g} kPa at which {path.name} stops: give a larger strain"
    )


@dataclasses.dataclass(frozen=True)
class Consolidation(StressPath):
    """Not a test: brings the three normal stresses to `pressure`, the initial state of CR and CP.

    The servo limits its strain rates to a multiple of `rate`.
    """

    rate: float | None = rate_parameter("scale of the largest strain rate", 5.0)

    name = "consolidation"
    direction = (0.0, 0.0, 0.0)
    standard_rate = 5.0

    def control(self) -> Control:
        return Control(np.eye(3), np.eye(3), np.full(3, self.held_pressure))


@dataclasses.dataclass(frozen=True)
class Biaxial(Path):
    """Not a test: brings a plane layer to sigma_x and sigma_z (Pa) at constant thickness."""

    stress_x: float = 0.1e6
    stress_z: float = 0.1e6

    name = "biaxial"
    direction = (0.0, 0.0, 0.0)
    standard_rate = 5.0

    def control(self) -> Control:
        plane = np.eye(3)[[0, 2]]
        return Control(plane, plane.T, np.array([self.stress_x, self.stress_z]))


_TESTS, _RELOADING, _CYCLES = (f"labkit.dem.{name}:" for name in ("element_tests", "stress_reversals", "cycles"))
PATHS: Registry = Registry(
    "path",
    {
        "cv": "labkit.dem.paths:ConstantVolume",
        "cr": "labkit.dem.paths:ConstantRadialStress",
        "cp": "labkit.dem.paths:ConstantMeanStress",
        "isoc": "labkit.dem.paths:IsotropicCompression",
        "isod": "labkit.dem.paths:IsotropicDilation",
        "cyclic_cp": "labkit.dem.paths:CyclicConstantMeanStress",
        "c1": _TESTS + "ConstantAxialStress",
        "true_triaxial": _TESTS + "TrueTriaxial",
        "plane_strain": _TESTS + "PlaneStrain",
        "oedometer": _TESTS + "Oedometer",
        "simple_shear": _TESTS + "SimpleShear",
        "simple_shear_cv": _TESTS + "SimpleShearConstantVolume",
        "stress_rotation": _TESTS + "StressRotation",
        "proportional": _TESTS + "ProportionalStrain",
        "mixed": _TESTS + "Mixed",
        "isotropic_reloading": _RELOADING + "IsotropicReloading",
        "oedometer_reloading": _RELOADING + "OedometerReloading",
        "steps": "labkit.dem.steps:Steps",
        "undrained_cycles": _CYCLES + "UndrainedCycles",
        "drained_cycles": _CYCLES + "DrainedCycles",
        "strain_cycles": _CYCLES + "StrainCycles",
        "shear_cycles": _CYCLES + "ShearCycles",
        "strain_probe": "labkit.dem.probes:StrainProbe",
        "stress_probe": "labkit.dem.probes:StressProbe",
    },
)


def register_path(kind: type[Path]) -> type[Path]:
    """Register a subclass of Path under its `name` and return it; a decorator.

    Raises InputError unless `direction` is three numbers with z not negative.
    """
    require_direction(kind)
    return PATHS.register(kind)


def make_path(name: str, parameters: Mapping[str, Any] | None = None) -> Path:
    """The path of that name; parameters that are None take their defaults.

    Raises InputError for an unknown path, a value that is out of range, or a parameter that the path does not have.
    """
    kind = PATHS.require(name)
    given = {key: value for key, value in (parameters or {}).items() if value is not None}
    for key in given:
        if key not in parameters_of(kind):
            raise InputError(f"is not a parameter of {name}: leave it out", field=key)
    for key, known in parameters_of(kind).items():
        if known.default is dataclasses.MISSING and key not in given:
            raise InputError("is missing", field=key, allowed=known.allowed)
    return kind(**given)


def path_of(name: str, values: Mapping[str, Any]) -> Path | None:
    """The path of a run file from its name and `path_parameters`; None if no path is registered under that name."""
    if name not in PATHS:
        return None
    kind = PATHS[name]
    return restored(kind, {key: value for key, value in values.items() if key in parameters_of(kind)})


def travelled(axial_strain: np.ndarray) -> np.ndarray:
    """Accumulated axial strain at each record, shape (n,); it increases through reversals."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(axial_strain)))])


def __getattr__(name: str) -> Any:
    """Loading paths defined in other modules: `labkit.paths.SimpleShear` and so on."""
    for module in ("element_tests", "stress_reversals", "cycles", "probes", "steps"):
        kind = getattr(importlib.import_module(f"labkit.dem.{module}"), name, None)
        if isinstance(kind, type) and issubclass(kind, Path) and not name.startswith("_"):
            return kind
    close = nearest(name, [] if name.startswith("_") else (kind.__name__ for kind in PATHS.values()))
    hint = f". Did you mean: {close!r}?" if close else ""
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    """Names in this module, and the classes of all registered paths."""
    return sorted({*globals(), *(kind.__name__ for kind in PATHS.values())})
