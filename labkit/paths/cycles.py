"""Cyclic triaxial and simple shear tests, drained and undrained, at a given stress, stress ratio or strain amplitude.

A cycle consists of two steps. The first step goes from the initial state to the positive amplitude; the next steps
alternate between the two amplitudes. From an anisotropic state, such as K0, cycles of a stress are about the stress at
the start: q alternates between q_0 + amplitude and q_0 - amplitude. An undrained test keeps the volume constant;
labkit.quantities defines its pore pressure, and labkit.paths.facts the number of cycles.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.parameters import Number, parameter
from labkit.paths.control import Control
from labkit.paths.element_tests import NORMAL, Sheared
from labkit.paths.path import Held, StressPath, rate_parameter, reversals
from labkit.paths.standard import hold_mean_stress
from labkit.paths.step import Here, Step, StrainExceeds, StrainLimit, Until
from labkit.paths.stress_reversals import StressReversals, longest_strain
from labkit.paths.undrained import Undrained

MOST_CYCLES = 10_000
LEAST_PRESSURE = 1e3  # Pa: below this pressure few contacts remain, and noise in q/p must not reverse a path
CONSOLIDATE = "isotropic stress to which the specimen is first consolidated (default: none)"
ISOTROPIC = 0.05  # of p, or of q/p: a smaller shear stress at the start is scatter of an isotropic specimen
SAME_CYCLES = 1.5  # of the amplitude: farther from the q_0 of earlier undrained loading, a path has its own q_0
DRAINED = "True to hold the stress, False for constant volume (undrained)"


def _about_start(path: StressReversals, amplitude: float, start: Here) -> tuple[float, float]:
    """Return the two levels between which a stress alternates: the static shear stress plus and minus the amplitude.

    The static shear stress is that at the start of the path, and 0 in an isotropic specimen. A path that continues
    undrained cycles keeps theirs.
    """
    first = start.stress if start.first is None else start.first
    if start.undrained is not None:
        apart = abs(path.scalar(first) - path.scalar(start.undrained))
        first = start.undrained if apart <= SAME_CYCLES * amplitude else first
    static = path.scalar(first)
    scatter = ISOTROPIC * (1.0 if "/" in path.scalar_name else float(mean_stress(first)))
    if abs(static) <= min(scatter, amplitude):
        static = 0.0
    return static + amplitude, static - amplitude


@dataclasses.dataclass(frozen=True)
class _StressCycles(StressReversals):
    """A path on which q, or q/p, alternates between its value at the start plus and minus the amplitude."""

    strain: Number[float] = longest_strain(4.0, 50.0)
    amplitude: Number[float] = parameter(
        50e3, unit="Pa", above=0.0, high=1e9, help="amplitude of q about q at the start; CSR is amplitude/(2 p)"
    )
    cycles: Number[int] = parameter(10, low=1, high=100000, help="number of cycles")
    ratio: Number[float | None] = parameter(None, above=0.0, high=3.0, help="amplitude of q/p, instead of that of q")
    strain_limit: Number[float] = parameter(0.1, above=0.0, high=1.0, help="axial strain at which the test ends")

    cyclic = True
    record_strain = 2e-4

    @property
    def scalar_name(self) -> str:
        return "q" if self.ratio is None else "q/p"

    def scalar(self, stress: np.ndarray) -> float:
        q, p = float(deviatoric_stress(stress)), float(mean_stress(stress))
        if self.ratio is None:
            return q
        return q / p if p > LEAST_PRESSURE else 0.0

    def levels(self, start: Here) -> Sequence[float]:
        return _about_start(self, self.amplitude if self.ratio is None else self.ratio, start) * self.cycles

    def limits(self) -> Until:
        return StrainLimit(self.strain) | StrainExceeds(self.strain_measure(), self.strain_limit)


@dataclasses.dataclass(frozen=True)
class UndrainedCycles(Undrained, _StressCycles):
    """Undrained cyclic triaxial test: constant volume, q alternates between q_0 +- `amplitude`.

    q_0 is q at the start, the static shear: zero in an isotropic specimen (below 5 % of p). A test that goes on from
    undrained cycles keeps their q_0. With a constant total mean stress the excess pore pressure is u = p_0 - p, and
    r_u = u/p_0; with a bulk modulus of the pore `water` the volume changes a little. The test ends after `cycles`
    cycles, or earlier if the axial strain exceeds `strain_limit` (the strain criterion for initial liquefaction).
    """

    cycles: Number[int] = parameter(100, low=1, high=100000, help="number of cycles")
    strain_limit: Number[float] = parameter(0.05, above=0.0, high=1.0, help="axial strain at which the test ends")
    pressure: Number[float | None] = parameter(None, unit="Pa", above=0.0, high=1e12, help=CONSOLIDATE)

    name = "undrained_cycles"
    direction = (-0.5, -0.5, 1.0)

    def start_pressure(self) -> float | None:
        return self.pressure


@dataclasses.dataclass(frozen=True)
class DrainedCycles(_StressCycles, StressPath):
    """Drained cyclic triaxial test: mean stress held at `pressure`, q alternates between q_0 +- `amplitude`.

    q_0 is q at the start, the static shear: zero in an isotropic specimen (below 5 % of p). The test
    ends after `cycles` cycles, or earlier if the axial strain exceeds `strain_limit`, as happens if the amplitude
    exceeds the strength.
    """

    name = "drained_cycles"
    holds = "mean stress"

    def control(self) -> Control:
        return hold_mean_stress(self.held_pressure)


@dataclasses.dataclass(frozen=True)
class _Drainage(StressPath):
    """A path that either holds a stress or keeps the volume constant."""

    pressure: Number[float | None] = parameter(
        None, unit="Pa", above=0.0, high=1e12, help="stress that a drained path holds; first consolidated to it"
    )
    drained: bool = parameter(True, help=DRAINED)

    def starting_at(self, pressure: float) -> StressPath:
        return super().starting_at(pressure) if self.drained else self

    def held(self) -> tuple[Held, ...]:
        return super().held() if self.drained else (Held("volume", "volume"),)


@dataclasses.dataclass(frozen=True)
class StrainCycles(_Drainage):
    """Cyclic triaxial test with a strain amplitude: the axial strain alternates between +- `strain_amplitude`.

    A drained test holds the mean stress at `pressure`; an undrained test keeps the volume constant.
    """

    strain: float = dataclasses.field(init=False, default=0.01)  # axial strain of the last reversal
    strain_amplitude: Number[float] = parameter(0.005, above=0.0, high=1.0, help="amplitude of the axial strain")
    cycles: Number[int] = parameter(10, low=1, high=MOST_CYCLES, help="number of cycles")

    name = "strain_cycles"
    cyclic = True
    holds = "mean stress"
    record_strain = 2e-4

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        super().__post_init__()
        object.__setattr__(self, "strain", -self.strain_amplitude)

    def flow(self, accumulated: float) -> np.ndarray:
        lateral = 0.0 if self.drained else -0.5
        return np.diag([lateral, lateral, 1.0])

    def steps_from(self, start: Here) -> Iterable[Step]:
        return reversals(self, (self.strain_amplitude, -self.strain_amplitude) * self.cycles)

    def control(self) -> Control | None:
        return hold_mean_stress(self.held_pressure) if self.drained else None


@dataclasses.dataclass(frozen=True)
class ShearCycles(Sheared, _Drainage, StressReversals):
    """Cyclic simple shear in the x-z plane, with an amplitude of sigma_xz or of gamma_xz; eps_x = eps_y = 0.

    A drained test holds sigma_z at `pressure`; in an undrained test the height, hence the volume, is constant. The
    test ends after `cycles` cycles, or earlier if gamma_xz exceeds `strain_limit`, as happens after liquefaction or if
    the amplitude exceeds the strength.
    """

    rate: Number[float | None] = rate_parameter("rate of the shear strain gamma_xz", 10.0)
    strain: Number[float] = longest_strain(4.0, 50.0)
    amplitude: Number[float | None] = parameter(
        None, unit="Pa", above=0.0, high=1e9, help="amplitude of sigma_xz about its start; CSR is amplitude/sigma_zz"
    )
    strain_amplitude: Number[float | None] = parameter(
        None, above=0.0, high=10.0, help="amplitude of gamma_xz, instead of that of sigma_xz (default: 0.01)"
    )
    cycles: Number[int] = parameter(10, low=1, high=MOST_CYCLES, help="number of cycles")
    spin: bool = parameter(True, help="simple shear; without spin: pure shear")
    strain_limit: Number[float] = parameter(
        0.1, above=0.0, high=10.0, help="gamma_xz at which a stress-controlled test ends"
    )

    name = "shear_cycles"
    cyclic = True
    holds = "normal stress"
    scalar_name = "sigma_xz"
    record_strain = 2e-4

    def __post_init__(self) -> None:
        """Check that only one amplitude is given. Raises InputError."""
        super().__post_init__()
        if self.amplitude is not None and self.strain_amplitude is not None:
            raise InputError("and amplitude are both given: give only one of them", field="strain_amplitude")

    def control(self) -> Control | None:
        return Control(NORMAL[2:], NORMAL[2:], [self.held_pressure]) if self.drained else None

    def held(self) -> tuple[Held, ...]:
        return (*super().held(), Held("strain in y", "strain", NORMAL[1:2]))

    def scalar(self, stress: np.ndarray) -> float:
        return 0.5 * float(stress[0, 2] + stress[2, 0])

    def levels(self, start: Here) -> Sequence[float]:
        amplitude = self.amplitude or np.inf  # a strain-controlled test does not reverse at a stress
        return _about_start(self, amplitude, start) * self.cycles

    def limits(self) -> Until:
        return StrainLimit(self.strain) | StrainExceeds(self.strain_measure(), self.strain_limit)

    def steps_from(self, start: Here) -> Iterable[Step]:
        if self.amplitude is not None:
            return super().steps_from(start)
        amplitude = 0.01 if self.strain_amplitude is None else self.strain_amplitude
        return reversals(self, (amplitude, -amplitude) * self.cycles)
