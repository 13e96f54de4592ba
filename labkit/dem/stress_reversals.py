"""Loading paths that reverse at given stresses: unloading and reloading, drained and undrained cycles."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from labkit.dem.control import Control
from labkit.dem.loading import Held, Path, StressPath, rate_parameter
from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.parameters import parameter


@dataclasses.dataclass(frozen=True)
class _StressReversals(Path):
    """A path that reverses whenever a stress reaches the next of `levels`."""

    def measured(self, stress: np.ndarray) -> float:
        """The stress that is compared with the levels, Pa."""
        return float(mean_stress(stress))

    def levels(self) -> tuple[float, ...]:
        """Stresses, Pa, at which the path reverses; it ends at the last one."""
        raise NotImplementedError

    def legs(self) -> int:
        return len(self.levels())

    def leg_ends(self, stress: np.ndarray, leg: int) -> bool:
        sign = 1.0 if leg % 2 == 0 else -1.0
        return sign * (self.measured(stress) - self.levels()[leg]) >= 0.0


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
    strain: float = parameter(
        0.5, above=0.0, high=10.0, help="maximum accumulated strain; the test ends there if it has not ended before"
    )
    pressures: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="mean stresses to reach in turn")

    name = "isotropic_reloading"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 5.0
    record_strain = 1e-4

    def __post_init__(self) -> None:
        """Checks the pressures. Raises InputError."""
        super().__post_init__()
        _require_alternating("pressures", self.pressures, "1e6,0.3e6,2e6")

    def levels(self) -> tuple[float, ...]:
        return self.pressures


@dataclasses.dataclass(frozen=True)
class OedometerReloading(_StressReversals):
    """One-dimensional (K0) compression with unloading and reloading: sigma_z visits `stresses` one after another."""

    strain: float = parameter(
        0.5, above=0.0, high=10.0, help="maximum accumulated strain; the test ends there if it has not ended before"
    )
    stresses: tuple[float, ...] = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="axial stresses to reach in turn")

    name = "oedometer_reloading"
    record_strain = 2e-4

    def __post_init__(self) -> None:
        """Checks the stresses. Raises InputError."""
        super().__post_init__()
        _require_alternating("stresses", self.stresses, "1e6,0.3e6,2e6")

    def measured(self, stress: np.ndarray) -> float:
        return float(stress[2, 2])

    def levels(self) -> tuple[float, ...]:
        return self.stresses

    def held(self) -> tuple[Held, ...]:
        return (Held("lateral strains", "strain", np.eye(3)[:2]),)


@dataclasses.dataclass(frozen=True)
class UndrainedCycles(_StressReversals):
    """Undrained cyclic triaxial test: constant volume, q alternates between +- `amplitude`.

    With a constant total mean stress the excess pore pressure is u = p_0 - p, and r_u = u/p_0. The test ends after
    `cycles` cycles, or earlier if the axial strain exceeds `strain_limit` (the strain criterion for initial
    liquefaction).
    """

    strain: float = parameter(
        4.0, above=0.0, high=50.0, help="maximum accumulated strain; the test ends there if it has not ended before"
    )
    amplitude: float = parameter(50e3, unit="Pa", above=0.0, high=1e9, help="amplitude of the deviatoric stress q")
    cycles: int = parameter(100, low=1, high=100000, help="number of cycles")
    strain_limit: float = parameter(0.05, above=0.0, high=1.0, help="axial strain at which the test ends")

    name = "undrained_cycles"
    direction = (-0.5, -0.5, 1.0)
    record_strain = 2e-4
    line_style = "-."

    def measured(self, stress: np.ndarray) -> float:
        return float(deviatoric_stress(stress))

    def levels(self) -> tuple[float, ...]:
        return (self.amplitude, -self.amplitude) * self.cycles

    def legs(self) -> int:
        return 2 * self.cycles

    def ends(self, record: Mapping[str, Any]) -> bool:
        return abs(record["axial_strain"]) > self.strain_limit

    def held(self) -> tuple[Held, ...]:
        return (Held("volume", "volume"),)


@dataclasses.dataclass(frozen=True)
class DrainedCycles(_StressReversals, StressPath):
    """Drained cyclic triaxial test: mean stress held at `pressure`, q alternates between +- `amplitude`."""

    strain: float = parameter(
        4.0, above=0.0, high=50.0, help="maximum accumulated strain; the test ends there if it has not ended before"
    )
    amplitude: float = parameter(50e3, unit="Pa", above=0.0, high=1e9, help="amplitude of the deviatoric stress q")
    cycles: int = parameter(10, low=1, high=100000, help="number of cycles")

    name = "drained_cycles"
    record_strain = 2e-4
    holds = "mean stress"
    line_style = "-."

    def measured(self, stress: np.ndarray) -> float:
        return float(deviatoric_stress(stress))

    def levels(self) -> tuple[float, ...]:
        return (self.amplitude, -self.amplitude) * self.cycles

    def legs(self) -> int:
        return 2 * self.cycles

    def control(self) -> Control:
        return Control(np.full((1, 3), 1 / 3), [[1.0], [1.0], [0.0]], [self.held_pressure])
