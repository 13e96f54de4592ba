"""The interface of a loading path: prescribed strain rates, controlled stresses, reversals and end.

A path is a frozen dataclass, independent of engines and files. It holds its complete description, which is used by the
simulation, the command line, campaigns, `verify` and the figures. To define a path, subclass Path and decorate the
class with `@labkit.register_path`; see examples/own_path.py. Directions are x, y, z; strain rates are logarithmic, 1/s,
compression positive.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np

from labkit.dem.control import Control, Target, six_columns
from labkit.dem.leg import Leg
from labkit.dem.scene import Scene
from labkit.dem.strain_measures import AXIAL, StrainMeasure
from labkit.errors import InputError
from labkit.io.schema import Variable
from labkit.micro.stress import mean_stress
from labkit.parameters import Named, check_parameters, parameter, parameters_of, restored

HELD = "stress that the path holds (default: the mean stress of the specimen)"
AnyPath = TypeVar("AnyPath", bound="Path")


@dataclasses.dataclass(frozen=True)
class Held:
    """A quantity that a path keeps constant, checked by `labkit verify`.

    kind: `stress`: measure : sigma stays at target (k,), Pa, which may be a function of the accumulated strain;
    `strain`: measure : strain stays zero; `volume`: the volume keeps its initial value. measure: k tensors as for a
    Control, stored with shape (k, 6). Raises InputError for another kind.
    """

    name: str
    kind: str
    measure: Any = None
    target: np.ndarray | Target | None = None

    def __post_init__(self) -> None:
        """Check the kind, and convert the measure to six components."""
        if self.measure is not None:
            object.__setattr__(self, "measure", six_columns(self.measure))
        if self.kind not in ("stress", "strain", "volume"):
            raise InputError("is unknown", field="kind", value=self.kind, allowed="stress, strain or volume")


def rate_parameter(what: str, standard: float) -> Any:
    """The field `rate` of a path whose `standard_rate` is `standard`, 1/s; `what`: description for the help text."""
    default = f"{standard:g} for D = 0.17 mm and rho = 2650 kg/m3, scaled with 1/(D sqrt(rho)) for other grains"
    return parameter(None, unit="1/s", above=0.0, high=1e10, help=f"{what} (default: {default})")


def require_direction(kind: type[Path]) -> None:
    """Raise InputError unless the `direction` of a path is three finite numbers with z not negative.

    Only the sign of the axial `strain` distinguishes compression (positive) from extension (negative).
    """
    try:
        direction = np.asarray(kind.direction, dtype=float)
    except (TypeError, ValueError):
        direction = np.empty(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or direction[2] < 0.0:
        allowed = (
            "strain rates in x, y and z divided by `rate`, with z not negative; for extension, reverse all three signs "
            "and make `strain` negative"
        )
        raise InputError(field="direction", value=kind.direction, allowed=allowed)


@dataclasses.dataclass(frozen=True)
class Path(Named, abc.ABC):
    """A loading path: the prescribed strain rates, the controlled stresses, the reversals and the end.

    A subclass has a `name` and a `direction`, the prescribed strain rates in x, y and z divided by the axial `rate`. If
    it has a `control`, the servo sets the remaining rates. A positive `strain` is compression, a negative one
    extension. Fields defined with labkit.parameter become options of the command line and keys of campaigns. Raises
    InputError for values outside their ranges.
    """

    rate: float | None = rate_parameter("axial strain rate", 10.0)
    strain: float = parameter(
        0.4, low=-2.0, high=2.0, help="axial strain to reach, logarithmic; negative for extension"
    )

    name: ClassVar[str]
    direction: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    standard_rate: ClassVar[float] = 10.0  # default axial rate for the grains of Table 1, 1/s
    shear: ClassVar[bool] = False  # True for a shear test, which tends to a critical state
    holds: ClassVar[str] = "stress"  # name of the controlled stress
    rate_limit: ClassVar[float] = 3.0  # largest strain rate of the servo, divided by `rate`
    axisymmetric: ClassVar[bool] = True  # False if sigma_x and sigma_y differ or there is shear: q is the invariant
    cyclic: ClassVar[bool] = False  # True if two legs make a cycle: figures are drawn against the number of cycles
    figure: ClassVar[str] = "test"  # the figure of Run.plot() and of a campaign, in labkit.runs.figures.FIGURES
    line_style: ClassVar[str | tuple[int, tuple[int, ...]]] = "-"  # of matplotlib, in figures
    record_strain: ClassVar[float] = 1e-3  # default axial strain between two records

    def __post_init__(self) -> None:
        """Check the direction and every parameter. Raises InputError."""
        require_direction(type(self))
        check_parameters(self)
        if self.strain == 0.0:
            raise InputError(field="strain", value=self.strain, allowed="a strain that is not zero")

    @classmethod
    def default_rate(cls, scene: Scene) -> float:
        """Default axial strain rate for the grains of a scene, 1/s.

        At a given mean stress p, the inertial number I = |D'| D sqrt(rho/p) (section 2, D' the strain rate tensor)
        keeps the value that it has for the grains of Table 1, D0 = 0.17 mm and rho0 = 2650 kg/m3:

            rate = standard_rate (D0/D) sqrt(rho0/rho)

        This is `standard_rate` exactly for Table 1. Young's modulus does not enter, because I does not depend on it. A
        subclass whose field `rate` has a number as its default keeps that number.
        """
        default = parameters_of(cls)["rate"].default
        if default is not None:
            return float(default)
        return (
            cls.standard_rate * (Scene.mean_diameter / scene.mean_diameter) * math.sqrt(Scene.density / scene.density)
        )

    @property
    def axial_rate(self) -> float:
        """Axial strain rate, 1/s. Raises InputError while `rate` is None; see `for_scene`."""
        if self.rate is None:
            raise InputError("is missing: give a rate, or create the path with `for_scene`", field="rate")
        return self.rate

    def at_rate(self: AnyPath, rate: float) -> AnyPath:
        """A copy of the path with another axial strain rate, 1/s."""
        return restored(type(self), {**self.given(), "rate": rate})

    def for_scene(self: AnyPath, scene: Scene) -> AnyPath:
        """The path with the default rate for the grains of a scene if no rate was given."""
        return self if self.rate is not None else self.at_rate(self.default_rate(scene))

    def flow(self, travelled: float) -> np.ndarray:
        """The prescribed velocity gradient divided by `rate`, (3, 3), at the accumulated strain `travelled`.

        Compression is positive. The symmetric part is the prescribed strain rate. The accumulated strain is the
        integral of |`rate`| over time. By default the gradient is constant, with the components of `direction` on its
        diagonal.
        """
        return np.diag(np.array(self.direction))

    def turning_points(self) -> tuple[float, ...]:
        """Axial strains at which the path reverses; the last one ends it."""
        return (self.strain,)

    @property
    def varies(self) -> bool:
        """True if the prescribed rates or the held stresses change with the accumulated strain."""
        control = self.control()
        moving = not np.array_equal(self.flow(0.0), self.flow(0.5 * abs(self.strain)))
        return moving or (control is not None and callable(control.target))

    def strain_measure(self) -> StrainMeasure:
        """The scalar strain by which the test is drawn, tabulated and followed; by default the axial strain."""
        return AXIAL

    def status(self, record: Mapping[str, Any], leg: int) -> str:
        """How far a test has come, for progress messages, from its latest record and the number of its leg."""
        measure = self.strain_measure()
        p = mean_stress(record["stress"]) / 1e3
        text = f"{measure.name} {measure.at(record['strain']):.2%}, p {p:.{1 if p < 1e3 else 0}f} kPa"
        if self.legs() == 1:
            return text
        number, of = (leg // 2, self.legs() // 2) if self.cyclic else (leg, self.legs())
        return f"{'cycle' if self.cyclic else 'leg'} {min(number + 1, of)} of {of}, {text}"

    def why_ended(self, record: Mapping[str, Any], leg: int) -> str:
        """Why a test that has ended did not reach its aim, one sentence; empty if it did.

        record: its last record; leg: number of legs that it completed, if it reverses on stress.
        """
        return ""

    def controlled(self, strain: np.ndarray, stress: np.ndarray) -> float:
        """The strain or stress at whose levels the path reverses, at one record: strain and stress (3, 3)."""
        return float(self.strain_measure().at(strain))

    def leg_target(self, leg: int) -> float:
        """The value of the controlled strain or stress at which leg number `leg`, from 0, ends."""
        return self.turning_points()[leg]

    @property
    def coaxial(self) -> bool:
        """True if the path neither prescribes nor controls a shear component: x, y and z are principal axes."""
        control, flow = self.control(), self.flow(0.0)
        return bool((control is None or control.coaxial) and np.array_equal(flow, np.diag(np.diag(flow))))

    def legs(self) -> int:
        """Number of legs, the pieces of the path between reversals."""
        return len(self.turning_points())

    def conditions(self) -> tuple[str | None, ...]:
        """The condition that ends each leg early, if any; see Leg.stops."""
        return ()

    def leg_ends(self, stress: np.ndarray, leg: int) -> bool:
        """True if leg number `leg`, from 0, ends at this stress (3, 3), Pa: the path reverses there, or ends."""
        return False

    @property
    def reverses_on_stress(self) -> bool:
        """True if the class defines `leg_ends`; `turning_points` then only limits the accumulated strain."""
        return type(self).leg_ends is not Path.leg_ends

    def ends(self, record: Mapping[str, Any]) -> bool:
        """True if the path ends at a record, given its variables by name (labkit.dem.measure)."""
        return False

    def control(self) -> Control | None:
        """The Control of the servo; None if all strain rates are prescribed."""
        return None

    @property
    def symmetric(self) -> bool:
        """True if the path treats x and y alike, and does not say otherwise: q is sigma_z - (sigma_x + sigma_y)/2."""
        with contextlib.suppress(InputError):  # without the pressure that it holds, a path has no control yet
            control = self.control()
            if self.direction[0] != self.direction[1] or not (control is None or control.axisymmetric):
                return False
        return self.axisymmetric

    def stops(self, pressure: float) -> bool:
        """True if the path ends at this mean stress, Pa, before it reaches its last strain."""
        return False

    @property
    def stops_early(self) -> bool:
        """True if the class defines `stops`, so that a run must check it."""
        return type(self).stops is not Path.stops

    @property
    def uses_servo(self) -> bool:
        """True if the path holds a stress."""
        return self.control() is not None

    def leg(
        self, number: int, sign: float, stress: np.ndarray, first: int = 0, steps: int = 0, step_strain: float = 0.0
    ) -> Leg:
        """The leg with this number, from 0.

        sign: of the strain rate; stress: at the start of the leg, (3, 3), Pa; first, steps: number of the time step at
        which it starts, and how many it takes (0 for the model, which has none); step_strain: accumulated strain of a
        time step.
        """
        return Leg(self, sign)

    def record_lengths(self, record_strain: float | None) -> tuple[float, ...] | None:
        """For each leg, the accumulated strain between two records; None if it is the same for all.

        record_strain: the value that the user chose, if any.
        """
        return None

    def recorded(self) -> Mapping[str, Variable]:
        """Variables that a run along this path records in addition to those of all runs; see Leg.progress."""
        return {}

    def stress_errors(self, record: Mapping[str, Any]) -> Mapping[str, np.ndarray]:
        """Further stresses that `labkit verify` checks: name -> measured minus intended at each record, (time,), Pa."""
        return {}

    def held(self) -> tuple[Held, ...]:
        """Quantities that `labkit verify` checks; by default the controlled stresses."""
        control = self.control()
        return () if control is None else (Held(self.holds, "stress", control.measure, control.target),)

    def start_pressure(self) -> float | None:
        """Isotropic pressure to which the specimen is first consolidated, Pa; None to keep its stresses."""
        return None

    def starting_at(self, pressure: float) -> Path:
        """The path for a specimen with this mean stress, Pa, which becomes the stress to hold if none was given."""
        return self

    def prescribed_stresses(self) -> dict[str, float]:
        """The largest stress that each field, or each step, of the path prescribes, name -> Pa."""
        fields = ("pressure", "pressures", "stresses")
        return {name: float(np.max(getattr(self, name, None) or 0.0)) for name in fields}

    def parameters(self) -> dict[str, Any]:
        """All fields, name -> value in SI units, for files."""
        return dataclasses.asdict(self)

    def require_consistent(self) -> None:
        """Raise InputError if the direction is invalid or the servo adjusts a strain rate that is prescribed."""
        require_direction(type(self))  # a subclass may replace __post_init__
        control = self.control()
        if control is not None:
            control.require_possible()
            both = control.free[:3].any(axis=1) & (np.diag(self.flow(0.0)) != 0.0)
            if both.any():
                names = ", ".join("xyz"[k] for k in np.flatnonzero(both))
                raise InputError(
                    f"path {self.name} prescribes the strain rate in {names} and also lets the servo adjust it: "
                    "choose one of the two"
                )

    def given(self) -> dict[str, Any]:
        """Fields that are arguments of the constructor, name -> value."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.init}


@dataclasses.dataclass(frozen=True)
class StressPath(Path):
    """A path that holds a stress. pressure: Pa; None stands for the mean stress of the specimen."""

    pressure: float | None = parameter(
        None,
        unit="Pa",
        above=0.0,
        high=1e12,
        help="stress that the path holds (default: the mean stress of the specimen)",
    )

    @property
    def held_pressure(self) -> float:
        """The stress to hold, Pa. Raises InputError while it is None; see `starting_at`."""
        if self.pressure is None:
            raise InputError(
                "is missing: give the stress to hold, or create the path with `starting_at`", field="pressure"
            )
        return self.pressure

    def start_pressure(self) -> float | None:
        return self.pressure

    def starting_at(self, pressure: float) -> StressPath:
        return self if self.pressure is not None else restored(type(self), {**self.given(), "pressure": pressure})
