"""Loading paths (section 2): strain rates that are given, stresses that are held, and when to stop.

A path knows no engine and no file. It is a frozen dataclass that says everything of itself: the simulation, the command
line, campaigns, `verify` and the figures ask it. A path of your own is a subclass of Path with
`@labkit.register_path`, see examples/own_path.py. Directions are x, y, z; strain rates are logarithmic, 1/s,
compression positive.
"""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from labkit.dem.control import Control, Target
from labkit.errors import InputError
from labkit.extensions import Registry
from labkit.micro.tensors import to_six
from labkit.parameters import check_parameters, parameter, parameters_of, restored

PRESSURE_LIMIT = 3e6  # Pa, of Table 1's grains: there the mean overlap reaches 2 %
REVERSALS = (0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04)


@dataclasses.dataclass(frozen=True)
class Held:
    """Something that a path keeps, for `labkit verify`.

    kind: `stress`: measure (k, 3) @ the normal stresses stays at target (k,), Pa; `strain`: measure (k, 3) @ the normal
    strains stays zero; `volume`: the volume stays what it was.
    """

    name: str
    kind: str
    measure: np.ndarray | None = None
    target: np.ndarray | Target | None = None

    def __post_init__(self) -> None:
        """Converts the measure to six components. Raises InputError for another kind."""
        if self.measure is not None:
            measure = np.asarray(self.measure, dtype=float)
            pad = ((0, 0), (0, 6 - measure.shape[-1]))
            object.__setattr__(self, "measure", to_six(measure) if measure.ndim == 3 else np.pad(measure, pad))
        if self.kind not in ("stress", "strain", "volume"):
            raise InputError("is unknown", field="kind", value=self.kind, allowed="stress, strain or volume")


@dataclasses.dataclass(frozen=True)
class Path(abc.ABC):
    """What is given, what is held, where it turns and ends, whether it is shear, and how it is drawn.

    A subclass has a `name` and a `direction`, the given strain rates in x, y and z over the axial `rate`; where it has
    a `control`, the servo moves what that leaves free. Its fields are made with labkit.parameter, and so are known to
    the command line and to campaigns. Raises InputError for values outside their ranges.
    """

    rate: float = parameter(10.0, unit="1/s", above=0.0, high=1e4, help="axial strain rate")
    strain: float = parameter(
        0.4, low=-2.0, high=2.0, help="axial strain to reach, logarithmic; negative for extension"
    )

    name: ClassVar[str]
    direction: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    shear: ClassVar[bool] = False  # whether it ends, if long enough, in a critical state
    holds: ClassVar[str] = "stress"  # the name of the stress that its control holds
    line_style: ClassVar[str] = "-"  # in figures, of matplotlib
    rate_limit: ClassVar[float] = 3.0  # of a strain rate that the servo finds, over `rate`
    record_strain: ClassVar[float] = 1e-3  # axial strain between two records, unless the user says otherwise

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)
        if self.strain == 0.0:
            raise InputError(field="strain", value=self.strain, allowed="a strain that is not zero")

    def flow(self, travelled: float) -> np.ndarray:
        """The prescribed velocity gradient over `rate`, (3, 3), compression positive, after the strain `travelled`.

        Its symmetric part is the strain rate. Here it is constant, with the components of `direction`.
        """
        return np.diag(np.array(self.direction))

    def legs(self) -> int:
        """Number of pieces between reversals."""
        return len(self.turning_points())

    def leg_ends(self, stress: np.ndarray, leg: int) -> bool:
        """True if the path reverses, or ends, at this stress (3, 3), Pa, in its piece number `leg`."""
        return False

    @property
    def reverses_on_stress(self) -> bool:
        """True if `leg_ends` decides where the path reverses, rather than `turning_points`."""
        return type(self).leg_ends is not Path.leg_ends

    def ends(self, record: Mapping[str, Any]) -> bool:
        """True if the path ends at a record, given its variables by name (labkit.dem.measure)."""
        return False

    def turning_points(self) -> tuple[float, ...]:
        """Axial strains at which the path turns; the last one ends it."""
        return (self.strain,)

    def control(self) -> Control | None:
        """The Control of the servo, or None when all rates are given."""
        return None

    def stops(self, pressure: float) -> bool:
        """Whether the path ends at this mean stress, Pa, before its last strain."""
        return False

    @property
    def stops_early(self) -> bool:
        """Whether `stops` has to be asked."""
        return type(self).stops is not Path.stops

    def held(self) -> tuple[Held, ...]:
        """What `labkit verify` checks of a run; here the stresses of the control."""
        control = self.control()
        return () if control is None else (Held(self.holds, "stress", control.measure, control.target),)

    def start_pressure(self) -> float | None:
        """The isotropic pressure, Pa, that a specimen is brought to first; None for that which it has."""
        return None

    def starting_at(self, pressure: float) -> Path:
        """The path for a specimen with this mean stress, Pa: a stress to hold that was not given is that one."""
        return self

    def parameters(self) -> dict[str, Any]:
        """Its fields, name -> value in SI units, for files."""
        return dataclasses.asdict(self)

    def require_consistent(self) -> None:
        """Raises InputError if the control moves a direction whose strain rate is given."""
        control = self.control()
        if control is not None:
            control.require_possible()
            both = control.free[:3].any(axis=1) & (np.diag(self.flow(0.0)) != 0.0)
            if both.any() and control.coaxial:
                names = ", ".join("xyz"[k] for k in np.flatnonzero(both))
                said = f"gives the strain rate in {names} and lets the servo find it too: do one of them"
                raise InputError(f"path {self.name} {said}")

    def given(self) -> dict[str, Any]:
        """Those of its fields that it is made with."""
        return {name: getattr(self, name) for name in parameters_of(type(self))}


@dataclasses.dataclass(frozen=True)
class StressPath(Path):
    """A path that holds a stress. pressure: Pa; None stands for the mean stress of the specimen."""

    pressure: float | None = parameter(None, unit="Pa", above=0.0, high=1e12, help="stress that the path holds")

    @property
    def held_pressure(self) -> float:
        """The stress that it holds, Pa. Raises InputError while it has none, see `starting_at`."""
        if self.pressure is None:
            raise InputError("is missing: give the stress to hold, or the path `starting_at` one", field="pressure")
        return self.pressure

    def start_pressure(self) -> float | None:
        return self.pressure

    def starting_at(self, pressure: float) -> StressPath:
        return self if self.pressure is not None else restored(type(self), {**self.given(), "pressure": pressure})


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
    """Cyclic CP: the axial direction turns at each of `reversals`, and the path ends at the last of them."""

    strain: float = dataclasses.field(init=False, default=0.04)  # the last reversal
    reversals: tuple[float, ...] = parameter(
        REVERSALS, help="axial strains at which the path turns, the last one ends it; with = if the first is negative"
    )

    name = "cyclic_cp"
    shear = False
    line_style = "-."

    def __post_init__(self) -> None:
        """Checks that it turns at every reversal. Raises InputError."""
        super().__post_init__()
        known = parameters_of(type(self))["reversals"]
        if not self.reversals:
            raise InputError("is empty", field="reversals", allowed="axial strains, e.g. 0.01,-0.01,0.02")
        steps = np.diff((0.0, *self.reversals))
        if not (np.isfinite(steps).all() and (np.abs(self.reversals) <= 2.0).all()):
            raise known.error(self.reversals, "holds a strain that is not possible", "numbers from -2 to 2")
        if (steps == 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
            said = "does not turn at each strain: go up and down in turn"
            raise known.error(self.reversals, said, "e.g. 0.01,-0.01,0.02")
        object.__setattr__(self, "strain", self.reversals[-1])

    def turning_points(self) -> tuple[float, ...]:
        return self.reversals


_EQUAL = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, -1.0]])


@dataclasses.dataclass(frozen=True)
class IsotropicCompression(Path):
    """ISOC, equal rates in the three directions until the mean stress reaches `pressure`."""

    rate: float = parameter(5.0, unit="1/s", above=0.0, high=1e4, help="strain rate in each direction")
    strain: float = parameter(0.1, above=0.0, high=2.0, help="strain at which it ends at the latest")
    pressure: float = parameter(PRESSURE_LIMIT, unit="Pa", above=0.0, high=1e12, help="mean stress at which it stops")

    name = "isoc"
    direction = (1.0, 1.0, 1.0)
    record_strain = 1e-4

    def stops(self, pressure: float) -> bool:
        return pressure >= self.pressure

    def held(self) -> tuple[Held, ...]:
        return (Held("three equal strains", "strain", _EQUAL),)


@dataclasses.dataclass(frozen=True)
class IsotropicDilation(Path):
    """ISOD, equal negative rates in the three directions until the mean stress falls under `pressure`."""

    rate: float = parameter(2.5, unit="1/s", above=0.0, high=1e4, help="strain rate in each direction")
    strain: float = parameter(-0.1, low=-2.0, high=-1e-9, help="strain at which it ends at the latest, negative")
    pressure: float = parameter(20e3, unit="Pa", above=0.0, high=1e12, help="mean stress under which it stops")

    name = "isod"
    direction = (1.0, 1.0, 1.0)
    record_strain = 1e-4

    def stops(self, pressure: float) -> bool:
        return pressure < self.pressure

    def held(self) -> tuple[Held, ...]:
        return (Held("three equal strains", "strain", _EQUAL),)


@dataclasses.dataclass(frozen=True)
class Consolidation(StressPath):
    """Not a test: brings the three normal stresses to `pressure`, the start of CR and CP."""

    rate: float = parameter(5.0, unit="1/s", above=0.0, high=1e4, help="scale of the largest strain rate")

    name = "consolidation"
    direction = (0.0, 0.0, 0.0)

    def control(self) -> Control:
        return Control(np.eye(3), np.eye(3), np.full(3, self.held_pressure))


@dataclasses.dataclass(frozen=True)
class Biaxial(Path):
    """Not a test: brings a plane layer to sigma_x and sigma_z (Pa), its thickness held."""

    rate: float = 5.0
    stress_x: float = 0.1e6
    stress_z: float = 0.1e6

    name = "biaxial"
    direction = (0.0, 0.0, 0.0)

    def control(self) -> Control:
        plane = np.eye(3)[[0, 2]]
        return Control(plane, plane.T, np.array([self.stress_x, self.stress_z]))


_TESTS = "labkit.dem.element_tests:"
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
        "isotropic_reloading": _TESTS + "IsotropicReloading",
        "oedometer_reloading": _TESTS + "OedometerReloading",
        "undrained_cycles": _TESTS + "UndrainedCycles",
        "drained_cycles": _TESTS + "DrainedCycles",
    },
)


def register_path(kind: type[Path]) -> type[Path]:
    """A decorator that makes a subclass of Path known under its `name`.

    Raises InputError for a direction that is not three numbers, or whose z is negative: extension is a negative strain.
    """
    direction = np.asarray(kind.direction, dtype=float)
    if direction.shape != (3,) or not np.isfinite(direction).all() or direction[2] < 0.0:
        allowed = "strain rates in x, y and z over `rate`, that of z not negative: extension is a negative `strain`"
        raise InputError(field="direction", value=kind.direction, allowed=allowed)
    return PATHS.register(kind)


def make_path(name: str, parameters: Mapping[str, Any] | None = None) -> Path:
    """The path of that name; parameters that are None take its defaults.

    Raises InputError for an unknown path, a value that is not possible, or a parameter that the path does not have.
    """
    kind = PATHS.require(name)
    given = {key: value for key, value in (parameters or {}).items() if value is not None}
    for key, _value in given.items():
        if key not in parameters_of(kind):
            raise InputError(f"is not a parameter of {name}: leave it out", field=key)
    for key, known in parameters_of(kind).items():
        if known.default is dataclasses.MISSING and key not in given:
            raise InputError("is missing", field=key, allowed=known.allowed)
    return kind(**given)


def path_of(name: str, values: Mapping[str, Any]) -> Path | None:
    """The path of a run file from its name and `path_parameters`; None where nobody here knows that path."""
    if name not in PATHS:
        return None
    kind = PATHS[name]
    return restored(kind, {key: value for key, value in values.items() if key in parameters_of(kind)})


def travelled(axial_strain: np.ndarray) -> np.ndarray:
    """Axial strain travelled until each record, shape (n,); it grows through reversals."""
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(axial_strain)))])
