"""Loading paths of section 2 and their registry; labkit.paths.path defines their interface."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import to_tensor
from labkit.parameters import Number, Numbers, parameter, parameters_of
from labkit.paths.control import Control
from labkit.paths.path import Held, Path, StressPath, rate_parameter, reversals, step_of
from labkit.paths.step import Here, Step, StrainReached, StressReached
from labkit.paths.strain_measures import VOLUMETRIC, StrainMeasure
from labkit.paths.undrained import Undrained

PRESSURE_LIMIT = 3e6  # Pa: at this pressure the mean overlap of the grains of Table 1 reaches 2 %
REVERSALS = (0.01, -0.01, 0.02, -0.02, 0.03, -0.03, 0.04)


@dataclasses.dataclass(frozen=True)
class ConstantVolume(Undrained):
    """CV, triaxial compression at constant volume: eps_x = eps_y = -eps_z/2 at a constant axial rate.

    With a bulk modulus of the pore `water` the volume changes a little: an undrained test at a constant total stress.
    """

    name = "cv"
    direction = (-0.5, -0.5, 1.0)
    shear = True


@dataclasses.dataclass(frozen=True)
class ConstantRadialStress(StressPath):
    """CR, drained triaxial compression: sigma_x = sigma_y = `pressure` at a constant axial rate."""

    name = "cr"
    shear = True
    holds = "radial stress"

    def control(self) -> Control:
        radial = np.eye(3)[:2]
        return Control(radial, radial.T, np.full(2, self.held_pressure))


@dataclasses.dataclass(frozen=True)
class ConstantMeanStress(StressPath):
    """CP, triaxial compression with the mean stress held at `pressure` by equal radial strains."""

    name = "cp"
    shear = True
    holds = "mean stress"

    def control(self) -> Control:
        return hold_mean_stress(self.held_pressure)


def hold_mean_stress(pressure: float) -> Control:
    """Return the Control that holds the mean stress, Pa, by equal strain rates in x and y."""
    return Control(np.full((1, 3), 1 / 3), [[1.0], [1.0], [0.0]], [pressure])


@dataclasses.dataclass(frozen=True)
class CyclicConstantMeanStress(ConstantMeanStress):
    """Cyclic CP: the axial strain rate reverses at each of `reversals`, and the path ends at the last of them."""

    strain: float = dataclasses.field(init=False, default=0.04)  # axial strain of the last reversal
    reversals: Numbers = parameter(
        REVERSALS,
        help="axial strains at which the path reverses; it ends at the last one. "
        "Write --reversals=-0.01,... if the first is negative",
    )

    name = "cyclic_cp"
    shear = False

    def __post_init__(self) -> None:
        """Check that the path reverses at every one of `reversals`. Raises InputError."""
        super().__post_init__()
        definition = parameters_of(type(self))["reversals"]
        if not self.reversals:
            raise InputError("is empty", field="reversals", allowed="axial strains, e.g. 0.01,-0.01,0.02")
        steps = np.diff((0.0, *self.reversals))
        if not (np.isfinite(steps).all() and (np.abs(self.reversals) <= 2.0).all()):
            raise definition.error(self.reversals, "contains a strain that is out of range", "numbers from -2 to 2")
        if (steps == 0.0).any() or (np.sign(steps[1:]) == np.sign(steps[:-1])).any():
            raise definition.error(
                self.reversals,
                "does not reverse at each strain",
                "strains that alternately increase and decrease, e.g. 0.01,-0.01,0.02",
            )
        object.__setattr__(self, "strain", self.reversals[-1])

    def steps_from(self, start: Here) -> Iterable[Step]:
        return reversals(self, self.reversals)


_PLANES = np.array([[0.0, 1.0, -1.0], [2.0, -1.0, -1.0]]) / np.sqrt([[2.0], [6.0]])  # orthonormal deviators
_EQUAL = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, -1.0]])


class _Isotropic(Path):
    """Equal strain rates in all directions until the mean stress reaches `pressure`."""

    direction = (1.0, 1.0, 1.0)
    record_strain = 1e-4

    def strain_measure(self) -> StrainMeasure:
        return VOLUMETRIC

    def held(self) -> tuple[Held, ...]:
        return (Held("three equal strains", "strain", _EQUAL),)


@dataclasses.dataclass(frozen=True)
class IsotropicCompression(_Isotropic):
    """ISOC, isotropic compression at equal rates in all directions until the mean stress reaches `pressure`."""

    rate: Number[float | None] = rate_parameter("strain rate in each direction", 5.0)
    strain: Number[float] = parameter(0.1, above=0.0, high=2.0, help="maximum strain")
    pressure: Number[float] = parameter(
        PRESSURE_LIMIT, unit="Pa", above=0.0, high=1e12, help="mean stress at which the test stops"
    )

    name = "isoc"
    standard_rate = 5.0

    def steps_from(self, start: Here) -> Iterable[Step]:
        end = StressReached("the mean stress", mean_stress, self.pressure)
        yield step_of(self, StrainReached(self.strain, self.strain) | end)


@dataclasses.dataclass(frozen=True)
class IsotropicDilation(_Isotropic):
    """ISOD, isotropic dilation at equal rates in all directions until the mean stress falls below `pressure`."""

    rate: Number[float | None] = rate_parameter("strain rate in each direction", 2.5)
    strain: Number[float] = parameter(-0.1, low=-2.0, high=-1e-9, help="maximum dilation, a negative strain")
    pressure: Number[float] = parameter(
        20e3, unit="Pa", above=0.0, high=1e12, help="mean stress below which the test stops"
    )

    name = "isod"
    standard_rate = 2.5

    def steps_from(self, start: Here) -> Iterable[Step]:
        end = StressReached("the mean stress", mean_stress, self.pressure, falling=True)
        yield step_of(self, StrainReached(-self.strain, self.strain) | end, -1.0)


CELLS = ("free", "fixed")
_SIX = to_tensor(np.eye(6))
_DEVIATORIC = np.concatenate([to_tensor(np.pad(_PLANES, ((0, 0), (0, 3)))), _SIX[3:]])


@dataclasses.dataclass(frozen=True)
class Consolidation(StressPath):
    """Not a test: brings the stress to the isotropic stress `pressure`, the initial state of CR and CP.

    All six components are brought to their targets if the `cell` is free: it also shears until the shear stresses are
    zero. If it is fixed, its angles stay, and so do the shear stresses; only the normal stresses are brought to
    `pressure`. The servo limits its strain rates to a multiple of `rate`.
    """

    rate: Number[float | None] = rate_parameter("scale of the largest strain rate", 5.0)
    cell: str = parameter(
        "free",
        choices=CELLS,
        help="free: the cell also shears until shear stresses are zero; fixed: its angles and the shear stresses stay "
        "(default: as the specimen was made)",
    )

    name = "consolidation"
    direction = (0.0, 0.0, 0.0)
    standard_rate = 5.0

    def control(self) -> Control:
        normal = np.full(3, self.held_pressure)
        if self.cell == "fixed":
            return Control(np.eye(3), np.eye(3), normal)
        return Control(_SIX, _SIX, np.concatenate([normal, np.zeros(3)]), triangular=True)


@dataclasses.dataclass(frozen=True)
class Levelling(Path):
    """Not a test: brings the stress deviator of a specimen to zero at constant volume.

    The servo limits its strain rates to a multiple of `rate`.
    """

    rate: Number[float | None] = rate_parameter("scale of the largest strain rate", 5.0)

    name = "levelling"
    direction = (0.0, 0.0, 0.0)
    standard_rate = 5.0

    def control(self) -> Control:
        return Control(_DEVIATORIC, _DEVIATORIC, np.zeros(5), triangular=True)


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
