"""The interface of a loading path: its steps, and the strain rates and stresses of its default step.

A path is a frozen dataclass, independent of engines and files. It contains the complete description of the loading for
the simulation, the command line, campaigns, `verify` and the figures. To define a path, subclass Path and decorate the
class with `@labkit.register_path`; see examples/own_path.py. Directions are x, y, z; strain rates are logarithmic, 1/s,
compression positive.
"""

from __future__ import annotations

import abc
import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator
from typing import Any, ClassVar

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import symmetric, to_six
from labkit.parameters import Number, check_parameters, parameter
from labkit.paths.control import Control, Target, six_columns
from labkit.paths.step import Here, Step, StrainReached, Until
from labkit.paths.strain_measures import AXIAL, StrainMeasure

HELD = "stress that the path holds (default: that of the specimen: its mean stress, or what an earlier run ended with)"


@dataclasses.dataclass(frozen=True, eq=False)
class Held:
    """A quantity that a path keeps constant, checked by `labkit verify`.

    If the kind is `stress`, measure : sigma stays at the target; if it is `strain`, measure : strain stays zero; if it
    is `volume`, the volume stays at its initial value; if it is `total`, measure : (sigma + u I) stays at its initial
    value, and the target is the bulk modulus of the pore water. Raises InputError for any other kind.

    Args:
        name: Name of the quantity.
        kind: "stress", "strain", "volume" or "total".
        measure: The k tensors M_i, as for a Control; stored with the shape (k, 6).
        target: Held stresses, (k,), Pa, or a function of the accumulated strain that returns them.
    """

    name: str
    kind: str
    measure: Any = None
    target: np.ndarray | Target | None = None

    def __post_init__(self) -> None:
        """Check the kind, and convert the measure to Mandel notation. Raises InputError."""
        if self.measure is not None:
            object.__setattr__(self, "measure", six_columns(self.measure))
        if self.kind not in ("stress", "strain", "volume", "total"):
            raise InputError("is unknown", field="kind", value=self.kind, allowed="stress, strain, volume or total")


def rate_parameter(what: str, standard: float) -> Number[float | None]:
    """Return the field `rate` of a path whose `standard_rate` is `standard`, 1/s; its help text starts with `what`."""
    default = f"{standard:g} for D = 0.17 mm and rho = 2650 kg/m3, scaled with 1/(D sqrt(rho)) for other grains"
    return parameter(None, unit="1/s", above=0.0, high=1e10, help=f"{what} (default: {default})")


def require_direction(kind: type[Path]) -> None:
    """Raise InputError unless the `direction` of a path is three finite numbers, the third of them not negative.

    The sign of the axial `strain` alone distinguishes compression (positive) from extension (negative).
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
class Path(abc.ABC):
    """A loading path: the prescribed strain rates, the controlled stresses, the reversals and the end.

    A subclass has a `name` and a `direction`, the prescribed strain rates in x, y and z divided by the axial `rate`. If
    the path has a `control`, the servo sets the remaining rates. A positive `strain` means compression, a negative
    `strain` extension. Fields defined with labkit.parameter become options of the command line and keys of campaigns.
    Raises InputError for values outside their ranges.
    """

    rate: Number[float | None] = rate_parameter("axial strain rate", 10.0)
    strain: Number[float] = parameter(
        0.4, low=-2.0, high=2.0, help="axial strain to reach, logarithmic; negative for extension"
    )

    name: ClassVar[str]
    direction: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    standard_rate: ClassVar[float] = 10.0  # default axial rate for the grains of Table 1, 1/s
    shear: ClassVar[bool] = False  # True for a shear test that leads to a critical state
    holds: ClassVar[str] = "stress"  # name of the controlled stress
    rate_limit: ClassVar[float] = 3.0  # largest strain rate of the servo, divided by `rate`
    axisymmetric: ClassVar[bool] = True  # False if sigma_x and sigma_y differ, or in shear: q is then the invariant
    cyclic: ClassVar[bool] = False  # True if two steps form a cycle: figures are drawn against the number of cycles
    record_strain: ClassVar[float] = 1e-3  # default accumulated strain between two records
    has_programmes: ClassVar[bool] = False  # True if the steps have programmes; runs record step number and progress

    def __post_init__(self) -> None:
        """Check the direction and every parameter. Raises InputError."""
        require_direction(type(self))
        check_parameters(self)
        if self.strain == 0.0:
            raise InputError(field="strain", value=self.strain, allowed="a strain that is not zero")

    @property
    def water(self) -> float | None:
        """Bulk modulus of the pore water in an undrained test whose volume changes, Pa."""
        return None

    @property
    def total(self) -> str | None:
        """Component of the total stress that is constant in an undrained test, if the path says so."""
        return None

    def flow(self, accumulated: float) -> np.ndarray:
        """Return the prescribed velocity gradient divided by `rate`, (3, 3), at the accumulated strain `accumulated`.

        Compression is positive. The symmetric part is the prescribed strain rate. The accumulated strain is the
        integral of |`rate`| over time. By default the gradient is constant, with the components of `direction` on its
        diagonal.
        """
        return np.diag(np.array(self.direction))

    def steps_from(self, start: Here) -> Iterable[Step]:
        """Yield the steps of the path, one after another.

        By default the path is a single step: it prescribes the rates `flow` and holds the stresses of `control` until
        the axial strain is `strain`. The walk updates `start` to the point where the next step starts.
        """
        yield step_of(self, StrainReached(abs(self.strain), self.strain), math.copysign(1.0, self.strain))

    def strain_measure(self) -> StrainMeasure:
        """Return the scalar strain used in figures, tables and progress messages; by default the axial strain."""
        return AXIAL

    def control(self) -> Control | None:
        """Return the Control of the servo; None if all strain rates are prescribed."""
        return None

    def held(self) -> tuple[Held, ...]:
        """Return the quantities that `labkit verify` checks; by default the controlled stresses."""
        control = self.control()
        return () if control is None else (Held(self.holds, "stress", control.measure, control.target),)

    def start_pressure(self) -> float | None:
        """Return the pressure to which the specimen is first consolidated, Pa; None to leave its stresses unchanged."""
        return None

    def starting_at(self, pressure: float) -> Path:
        """Return the path for a specimen with this mean stress, Pa; the path holds it if no other stress was given."""
        return self


def step_of(path: Path, until: Until, sign: float = 1.0) -> Step:
    """Return a step with the prescribed rates of a path, multiplied by `sign`, and its held stresses."""
    rates = sign * path.flow(0.0) if type(path).flow is Path.flow else lambda strain: sign * path.flow(strain)
    return Step(rates, path.control(), until, path.rate_limit)


def reversals(path: Path, strains: Iterable[float]) -> Iterator[Step]:
    """Yield steps that bring the strain of a path to each of `strains` in turn; the path reverses at these strains."""
    back, ahead = (step_of(path, StrainReached(0.0), sign) for sign in (-1.0, 1.0))
    for before, turn in itertools.pairwise((0.0, *strains)):
        until = StrainReached(abs(turn - before), turn)
        yield dataclasses.replace(ahead if turn > before else back, until=until)


def number_of_steps(path: Path) -> int:
    """Return the number of steps of a path."""
    return sum(1 for _ in path.steps_from(Here()))


def holds_stress(path: Path) -> bool:
    """Return True if the servo holds a stress in a step of the path."""
    return any(step.held is not None for step in path.steps_from(Here()))


def is_coaxial(path: Path) -> bool:
    """Return True if a path neither prescribes nor controls a shear component: x, y and z are principal axes."""
    control, flow = path.control(), path.flow(0.0)
    return bool((control is None or control.coaxial) and np.array_equal(flow, np.diag(np.diag(flow))))


def require_consistent(path: Path) -> None:
    """Raise InputError if the direction of a path is invalid or the servo adjusts a strain rate that is prescribed."""
    require_direction(type(path))  # a subclass may replace __post_init__
    control = path.control()
    if control is not None:
        control.require_possible()
    if control is not None and control.water is None:
        flow = to_six(symmetric(path.flow(0.0)))
        adjusted = control.free @ np.linalg.pinv(control.free) @ flow
        if np.abs(adjusted).max() > 1e-9:
            both = np.abs(np.where(flow == 0.0, 0.0, adjusted)) > 1e-9
            names = ", ".join("xyz"[k] for k in np.flatnonzero(both[:3])) or "shear"
            raise InputError(
                f"path {path.name} prescribes the strain rate in {names} and also lets the servo adjust it: "
                "choose one of the two"
            )


@dataclasses.dataclass(frozen=True)
class StressPath(Path):
    """A path that holds a stress: `pressure`, Pa, or the mean stress of the specimen if `pressure` is None."""

    pressure: Number[float | None] = parameter(None, unit="Pa", above=0.0, high=1e12, help=HELD)

    @property
    def held_pressure(self) -> float:
        """Return the stress to hold, Pa. Raises InputError while it is None (see `starting_at`)."""
        if self.pressure is None:
            raise InputError(
                "is missing: give the stress to hold, or create the path with `starting_at`", field="pressure"
            )
        return self.pressure

    def start_pressure(self) -> float | None:
        return self.pressure

    def starting_at(self, pressure: float) -> StressPath:
        return self if self.pressure is not None else dataclasses.replace(self, pressure=pressure)
