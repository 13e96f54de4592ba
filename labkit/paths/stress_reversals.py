"""Loading paths that reverse at given stresses, such as isotropic and K0 compression with unloading loops."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.parameters import Number, Numbers, parameter
from labkit.paths.path import Held, Path, rate_parameter, step_of
from labkit.paths.step import Here, Step, StrainLimit, StressReached, Until
from labkit.paths.strain_measures import VOLUMETRIC, StrainMeasure


def longest_strain(default: float, high: float) -> Number[float]:
    """Return the field `strain` of a path that usually ends at a stress: the limit of the accumulated strain."""
    text = "maximum accumulated strain; the test ends there if it has not ended before"
    return parameter(default, above=0.0, high=high, help=text)


@dataclasses.dataclass(frozen=True)
class StressReversals(Path):
    """A path that reverses when a stress, or a stress ratio, reaches one level after another."""

    @property
    @abc.abstractmethod
    def scalar_name(self) -> str:
        """Return the name of the stress that is compared with the levels."""

    @abc.abstractmethod
    def scalar(self, stress: np.ndarray) -> float:
        """Return the stress that is compared with the levels, Pa, or a ratio of stresses."""

    @abc.abstractmethod
    def levels(self, start: Here) -> Sequence[float]:
        """Return the stresses at which the steps end, Pa, or ratios of stresses; the last one ends the path."""

    def limits(self) -> Until:
        """Return the conditions other than stresses that end the path: by default the accumulated strain `strain`."""
        return StrainLimit(float(self.strain))

    def steps_from(self, start: Here) -> Iterable[Step]:
        limits = self.limits()
        both = step_of(self, limits), step_of(self, limits, -1.0)
        for number, level in enumerate(self.levels(start)):
            falling = number % 2 == 1
            end = StressReached(self.scalar_name, self.scalar, level, falling)
            yield dataclasses.replace(both[falling], until=end | limits)


def _require_alternating(name: str, values: tuple[float, ...], example: str) -> None:
    """Raise InputError unless the values rise and fall in turn."""
    steps = np.diff(values)
    if not values or not np.isfinite(values).all() or min(values) <= 0.0:
        raise InputError(field=name, value=values, allowed=f"positive stresses, e.g. {example}")
    if (steps == 0.0).any() or (steps[:1] > 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
        raise InputError("does not alternate: unload and reload in turn", field=name, value=values, allowed=example)


@dataclasses.dataclass(frozen=True)
class IsotropicReloading(StressReversals):
    """Isotropic compression with unloading and reloading: the mean stress reaches `pressures` in turn."""

    rate: Number[float | None] = rate_parameter("strain rate in each direction", 5.0)
    strain: Number[float] = longest_strain(0.5, 10.0)
    pressures: Numbers = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="mean stresses to reach in turn")

    name = "isotropic_reloading"
    direction = (1.0, 1.0, 1.0)
    standard_rate = 5.0
    record_strain = 1e-4
    scalar_name = "the mean stress"

    def __post_init__(self) -> None:
        """Check the pressures. Raises InputError."""
        super().__post_init__()
        _require_alternating("pressures", self.pressures, "1e6,0.3e6,2e6")

    def strain_measure(self) -> StrainMeasure:
        return VOLUMETRIC

    def scalar(self, stress: np.ndarray) -> float:
        return float(mean_stress(stress))

    def levels(self, start: Here) -> Sequence[float]:
        return self.pressures


@dataclasses.dataclass(frozen=True)
class OedometerReloading(StressReversals):
    """One-dimensional (K0) compression to one stress or several, with unloading: sigma_z reaches `stresses` in turn.

    One stress is K0 consolidation to this sigma_z.
    """

    strain: Number[float] = longest_strain(0.5, 10.0)
    stresses: Numbers = parameter((1e6, 0.3e6, 2e6), unit="Pa", help="axial stresses to reach in turn")

    name = "oedometer_reloading"
    record_strain = 2e-4
    scalar_name = "sigma_zz"

    def __post_init__(self) -> None:
        """Check the stresses. Raises InputError."""
        super().__post_init__()
        _require_alternating("stresses", self.stresses, "1e6,0.3e6,2e6")

    def scalar(self, stress: np.ndarray) -> float:
        return float(stress[2, 2])

    def levels(self, start: Here) -> Sequence[float]:
        return self.stresses

    def held(self) -> tuple[Held, ...]:
        return (Held("lateral strains", "strain", np.eye(3)[:2]),)
