"""Loading paths that reverse at given stresses: unloading and reloading, drained and undrained cycles."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from labkit.dem.control import Control
from labkit.dem.loading import Held, Path, StressPath, rate_parameter
from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.parameters import parameter


def longest_strain(default: float, high: float) -> Any:
    """The field `strain` of a path that usually ends at a stress."""
    text = "maximum accumulated strain; the test ends there if it has not ended before"
    return parameter(default, above=0.0, high=high, help=text)


@dataclasses.dataclass(frozen=True)
class _StressReversals(Path):
    """A path that reverses when a stress reaches the level of its leg."""

    @abc.abstractmethod
    def measured(self, stress: np.ndarray) -> float:
        """The stress that is compared with the levels, Pa."""

    @abc.abstractmethod
    def level(self, leg: int) -> float:
        """The stress at which a leg ends, Pa."""

    def leg_ends(self, stress: np.ndarray, leg: int) -> bool:
        sign = 1.0 if leg % 2 == 0 else -1.0
        return sign * (self.measured(stress) - self.level(leg)) >= 0.0


@dataclasses.dataclass(frozen=True)
class _StressCycles(_StressReversals):
    """A path on which q alternates between +- `amplitude`."""

    strain: float = longest_strain(4.0, 50.0)
    amplitude: float = parameter(50e3, unit="Pa", above=0.0, high=1e9, help="amplitude of the deviatoric stress q")
    cycles: int = parameter(10, low=1, high=100000, help="number of cycles")

    record_strain = 2e-4
    line_style = "-."

    def measured(self, stress: np.ndarray) -> float:
        return float(deviatoric_stress(stress))

    def level(self, leg: int) -> float:
        return self.amplitude if leg % 2 == 0 else -self.amplitude

    def legs(self) -> int:
        return 2 * self.cycles


def _require_alternating(name: str, values: tuple[float, ...], example: str) -> None:
    """Raises InputError unless the values go up and down in turn."""
    steps = np.diff(values)
    if not values or not np.isfinite(values).all() or min(values) <= 0.0:
        raise InputError(field=name, value=values, allowed=f"positive stresses, e.g. {example}")
    if (steps == 0.0).any() or (steps[:1] > 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
        raise InputError("does not alternate: unload and reload in turn", field=name, value=values, allowed=example)


@dataclasses.dataclass(frozen=True)
class IsotropicReloading(_StressReversals):
    """Isotropic compression with unloading and reloading: the mean stress visits `pressures` one after another."""

    rate: float | None = rate_parameter("strain rate in each direction", 5.0)
    strain: float = longest_strain(0.5, 10.0)
    pressures: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="mean stresses to reach in turn")

    name = "isotropic_reloading"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 5.0
    record_strain = 1e-4

    def __post_init__(self) -> None:
        """Checks the pressures. Raises InputError."""
        super().__post_init__()
        _require_alternating("pressures", self.pressures, "1e6,0.3e6,2e6")

    def measured(self, stress: np.ndarray) -> float:
        return float(mean_stress(stress))

    def level(self, leg: int) -> float:
        return self.pressures[leg]

    def legs(self) -> int:
        return len(self.pressures)


@dataclasses.dataclass(frozen=True)
class OedometerReloading(_StressReversals):
    """One-dimensional (K0) compression with unloading and reloading: sigma_z visits `stresses` one after another."""

    strain: float = longest_strain(0.5, 10.0)
    stresses: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="axial stresses to reach in turn")

    name = "oedometer_reloading"
    record_strain = 2e-4

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


@dataclasses.dataclass(frozen=True)
class UndrainedCycles(_StressCycles):
    """Undrained cyclic triaxial test: constant volume, q alternates between +- `amplitude`.

    With a constant total mean stress the excess pore pressure is u = p_0 - p, and r_u = u/p_0. The test ends after
    `cycles` cycles, or earlier if the axial strain exceeds `strain_limit` (the strain criterion for initial
    liquefaction).
    """

    cycles: int = parameter(100, low=1, high=100000, help="number of cycles")
    strain_limit: float = parameter(0.05, above=0.0, high=1.0, help="axial strain at which the test ends")

    name = "undrained_cycles"
    direction = (-0.5, -0.5, 1.0)

    def ends(self, record: Mapping[str, Any]) -> bool:
        return abs(record["axial_strain"]) > self.strain_limit

    def held(self) -> tuple[Held, ...]:
        return (Held("volume", "volume"),)


@dataclasses.dataclass(frozen=True)
class DrainedCycles(_StressCycles, StressPath):
    """Drained cyclic triaxial test: mean stress held at `pressure`, q alternates between +- `amplitude`."""

    name = "drained_cycles"
    holds = "mean stress"

    def control(self) -> Control:
        return Control(np.full((1, 3), 1 / 3), [[1.0], [1.0], [0.0]], [self.held_pressure])
