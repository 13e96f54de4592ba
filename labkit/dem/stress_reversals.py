"""Loading paths that reverse at given stresses, and among them isotropic and K0 compression with unloading loops."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from labkit.dem.loading import Held, Path, rate_parameter
from labkit.dem.strain_measures import VOLUMETRIC, StrainMeasure
from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.parameters import parameter


def longest_strain(default: float, high: float) -> Any:
    """The field `strain` of a path that usually ends at a stress."""
    text = "maximum accumulated strain; the test ends there if it has not ended before"
    return parameter(default, above=0.0, high=high, help=text)


@dataclasses.dataclass(frozen=True)
class StressReversals(Path):
    """A path that reverses when a stress, or a stress ratio, reaches the level of its leg."""

    @property
    @abc.abstractmethod
    def measured_name(self) -> str:
        """Name of the stress that is compared with the levels."""

    @abc.abstractmethod
    def measured(self, stress: np.ndarray) -> float:
        """The stress that is compared with the levels, Pa, or a ratio of stresses."""

    @abc.abstractmethod
    def level(self, leg: int) -> float:
        """The stress at which a leg ends, Pa, or a ratio of stresses."""

    def controlled(self, strain: np.ndarray, stress: np.ndarray) -> float:
        return self.measured(stress) if self.reverses_on_stress else super().controlled(strain, stress)

    def leg_target(self, leg: int) -> float:
        return self.level(leg) if self.reverses_on_stress else super().leg_target(leg)

    def leg_ends(self, stress: np.ndarray, leg: int) -> bool:
        sign = 1.0 if leg % 2 == 0 else -1.0
        return sign * (self.measured(stress) - self.level(leg)) >= 0.0

    def why_ended(self, record: Mapping[str, Any], leg: int) -> str:
        if not self.reverses_on_stress or leg >= self.legs():
            return ""
        unit, factor = ("", 1.0) if "/" in self.measured_name else (" kPa", 1e-3)
        now, target = factor * self.measured(record["stress"]), factor * self.level(leg)
        return (
            f"{self.limit_reached(record)} while {self.measured_name} was {now:.4g}{unit}, short of {target:.4g}{unit}"
        )

    def limit_reached(self, record: Mapping[str, Any]) -> str:
        """The limit at which a test ended before its last leg was complete, as text."""
        return f"the accumulated strain reached its limit of {self.strain:g}"


def _require_alternating(name: str, values: tuple[float, ...], example: str) -> None:
    """Raises InputError unless the values go up and down in turn."""
    steps = np.diff(values)
    if not values or not np.isfinite(values).all() or min(values) <= 0.0:
        raise InputError(field=name, value=values, allowed=f"positive stresses, e.g. {example}")
    if (steps == 0.0).any() or (steps[:1] > 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
        raise InputError("does not alternate: unload and reload in turn", field=name, value=values, allowed=example)


@dataclasses.dataclass(frozen=True)
class IsotropicReloading(StressReversals):
    """Isotropic compression with unloading and reloading: the mean stress visits `pressures` one after another."""

    rate: float | None = rate_parameter("strain rate in each direction", 5.0)
    strain: float = longest_strain(0.5, 10.0)
    pressures: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="mean stresses to reach in turn")

    name = "isotropic_reloading"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 5.0
    record_strain = 1e-4
    measured_name = "the mean stress"

    def __post_init__(self) -> None:
        """Checks the pressures. Raises InputError."""
        super().__post_init__()
        _require_alternating("pressures", self.pressures, "1e6,0.3e6,2e6")

    def strain_measure(self) -> StrainMeasure:
        return VOLUMETRIC

    def measured(self, stress: np.ndarray) -> float:
        return float(mean_stress(stress))

    def level(self, leg: int) -> float:
        return self.pressures[leg]

    def legs(self) -> int:
        return len(self.pressures)


@dataclasses.dataclass(frozen=True)
class OedometerReloading(StressReversals):
    """One-dimensional (K0) compression with unloading and reloading: sigma_z visits `stresses` one after another."""

    strain: float = longest_strain(0.5, 10.0)
    stresses: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="axial stresses to reach in turn")

    name = "oedometer_reloading"
    record_strain = 2e-4
    measured_name = "sigma_zz"

    def __post_init__(self) -> None:
        """Checks the stresses. Raises InputError."""
        super().__post_init__()
        _require_alternating("stresses", self.stresses, "1e6,0.3e6,2e6")

    def measured(self, stress: np.ndarray) -> float:
        return float(stress[2, 2])

    def level(self, leg: int) -> float:
        return self.stresses[leg]

    def legs(self) -> int:
        return len(self.stresses)

    def held(self) -> tuple[Held, ...]:
        return (Held("lateral strains", "strain", np.eye(3)[:2]),)
