"""Monotonic loading paths beyond those of the paper: true triaxial, plane strain, simple shear, rotating stresses.

Each path is a mixed control (labkit.paths.control). Strain rates and stresses are positive in compression; a shear
strain rate d(gamma_xz)/dt has the same sign as the shear stress sigma_xz that it causes.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from labkit.errors import InputError
from labkit.micro.tensors import require_symmetric, to_six, to_tensor
from labkit.parameters import Number, Numbers, parameter, parameters_of
from labkit.paths.control import Control
from labkit.paths.mixed_step import components_of, tensors_of
from labkit.paths.path import Held, Path, StressPath, rate_parameter
from labkit.paths.strain_measures import NORM, PURE_SHEAR, SHEAR, StrainMeasure

SHEAR_XZ = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])  # SHEAR_XZ : sigma = sigma_xz
SIMPLE_SHEAR = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
NORMAL = np.eye(3)[:, :, None] * np.eye(3)[:, None, :]  # NORMAL[2] : sigma = sigma_zz


@dataclasses.dataclass(frozen=True)
class ConstantAxialStress(StressPath):
    """Axial stress held at `pressure`; equal radial strain rates."""

    name = "c1"
    shear = True
    holds = "axial stress"

    def control(self) -> Control:
        return Control([[0.0, 0.0, 1.0]], [[1.0], [1.0], [0.0]], [self.held_pressure])


@dataclasses.dataclass(frozen=True)
class TrueTriaxial(StressPath):
    """Mean stress held at `pressure` with a constant ratio b of the principal stresses.

        b = (sigma_y - sigma_x)/(sigma_z - sigma_x)

    b = 0 is triaxial compression, b = 1 triaxial extension with sigma_x as the minor stress. The Lode angle theta, 0 to
    60 degrees, can be given instead of b: tan(theta) = sqrt(3) b/(2 - b).
    """

    b: Number[float | None] = parameter(
        None, low=0.0, high=1.0, help="intermediate principal stress ratio (default: 0.5)"
    )
    lode_angle: Number[float | None] = parameter(
        None, low=0.0, high=60.0, help="Lode angle, degrees, instead of b: 0 compression, 60 extension"
    )

    name = "true_triaxial"
    shear = True
    axisymmetric = False
    rate_limit = 8.0  # at b = 1 the magnitude of the least principal strain rate is 2 or more

    def __post_init__(self) -> None:
        """Check that b and the Lode angle are not both given. Raises InputError."""
        super().__post_init__()
        if self.b is not None and self.lode_angle is not None:
            raise InputError("and b are both given: give only one of them", field="lode_angle")

    @property
    def ratio(self) -> float:
        """The ratio b."""
        if self.lode_angle is None:
            return 0.5 if self.b is None else self.b
        tangent = np.tan(np.radians(self.lode_angle))
        return float(2.0 * tangent / (np.sqrt(3.0) + tangent))

    def control(self) -> Control:
        b = self.ratio
        measure = [[1 / 3, 1 / 3, 1 / 3], [b - 1.0, 1.0, -b]]
        return Control(measure, np.eye(3)[:, :2], [self.held_pressure, 0.0])

    def held(self) -> tuple[Held, ...]:
        control = self.control()
        return (
            Held("mean stress", "stress", control.measure[:1], control.target[:1]),
            Held(f"b = {self.ratio:.3g}", "stress", control.measure[1:], control.target[1:]),
        )


@dataclasses.dataclass(frozen=True)
class PlaneStrain(StressPath):
    """Plane strain (biaxial) test: eps_y = 0, sigma_x held at `pressure`."""

    name = "plane_strain"
    shear = True
    axisymmetric = False
    holds = "lateral stress"

    def control(self) -> Control:
        return Control([[1.0, 0.0, 0.0]], [[1.0], [0.0], [0.0]], [self.held_pressure])

    def held(self) -> tuple[Held, ...]:
        return (*super().held(), Held("strain in y", "strain", np.array([[0.0, 1.0, 0.0]])))


@dataclasses.dataclass(frozen=True)
class Oedometer(Path):
    """One-dimensional (K0) compression to a strain: eps_x = eps_y = 0. To a stress: the path oedometer_reloading."""

    strain: Number[float] = parameter(0.1, above=0.0, high=2.0, help="axial strain to reach, logarithmic")

    name = "oedometer"

    def held(self) -> tuple[Held, ...]:
        return (Held("lateral strains", "strain", np.eye(3)[:2]),)


class Sheared(Path):
    """A path of simple shear in the x-z plane or, without `spin`, of pure shear, with d(gamma_xz)/dt = `rate`."""

    spin: bool

    axisymmetric = False

    def flow(self, accumulated: float) -> np.ndarray:
        return SIMPLE_SHEAR if self.spin else SHEAR_XZ

    def strain_measure(self) -> StrainMeasure:
        return SHEAR if self.spin else PURE_SHEAR


@dataclasses.dataclass(frozen=True)
class _SimpleShear(Sheared):
    """Simple shear in the x-z plane, with d(gamma_xz)/dt = `rate`."""

    rate: Number[float | None] = rate_parameter("rate of the shear strain gamma_xz", 10.0)
    strain: Number[float] = parameter(0.4, above=0.0, high=10.0, help="shear strain gamma_xz to reach")
    spin: bool = parameter(True, help="simple shear; without spin: pure shear")

    shear = True


@dataclasses.dataclass(frozen=True)
class SimpleShear(_SimpleShear, StressPath):
    """Simple shear in the x-z plane with sigma_z held at `pressure` and eps_x = eps_y = 0.

    The cell is sheared at d(gamma_xz)/dt = `rate`: v_x changes with z. If `spin` is False, the same strain rate is
    imposed without rotation (pure shear).
    """

    name = "simple_shear"
    holds = "normal stress"

    def control(self) -> Control:
        return Control(NORMAL[2:], NORMAL[2:], [self.held_pressure])

    def held(self) -> tuple[Held, ...]:
        return (*super().held(), Held("strain in y", "strain", NORMAL[1:2]))


@dataclasses.dataclass(frozen=True)
class SimpleShearConstantVolume(_SimpleShear):
    """Simple shear in the x-z plane at constant height, hence constant volume."""

    name = "simple_shear_cv"

    def held(self) -> tuple[Held, ...]:
        return (Held("volume", "volume"), Held("strain in y", "strain", NORMAL[1:2]))


@dataclasses.dataclass(frozen=True)
class StressRotation(StressPath):
    """Rotation of the principal stresses at constant p, q and b = 0.5.

    All six stresses are controlled. Over the first tenth of the accumulated `strain` the deviator grows to
    `stress_ratio` = q/p with sigma_1 along z; then sigma_1 rotates about y by `rotation`.
    """

    strain: Number[float] = parameter(0.4, above=0.0, high=10.0, help="rate times the duration of the test")
    stress_ratio: Number[float] = parameter(
        0.4, above=0.0, high=1.5, help="ratio q/p, held constant while sigma_1 rotates"
    )
    rotation: Number[float] = parameter(180.0, above=0.0, high=3600.0, help="angle of rotation of sigma_1, degrees")

    name = "stress_rotation"
    axisymmetric = False

    def flow(self, accumulated: float) -> np.ndarray:
        return np.zeros((3, 3))

    def stress_at(self, accumulated: float) -> np.ndarray:
        """Return the target stress (3, 3), Pa, at the accumulated strain `accumulated`."""
        p, ramp = self.held_pressure, 0.1 * self.strain
        radius = self.stress_ratio * p * min(accumulated / ramp, 1.0) / np.sqrt(3.0)  # q = sqrt(3) radius at b = 0.5
        twice = 2.0 * np.radians(self.rotation) * max(accumulated - ramp, 0.0) / (self.strain - ramp)
        normal, shear = radius * np.cos(twice), radius * np.sin(twice)
        return p * np.eye(3) + np.array([[-normal, 0.0, shear], [0.0, 0.0, 0.0], [shear, 0.0, normal]])

    def strain_measure(self) -> StrainMeasure:
        return NORM

    def control(self) -> Control:
        basis = to_tensor(np.eye(6))
        return Control(basis, basis, lambda accumulated: np.einsum("aij,ij->a", basis, self.stress_at(accumulated)))


@dataclasses.dataclass(frozen=True)
class ProportionalStrain(Path):
    """Proportional strain path: constant ratios of the strain rates."""

    ratios: Numbers = parameter((-0.5, -0.5, 1.0), help="strain rates xx,yy,zz or xx,yy,zz,yz,xz,xy, divided by `rate`")

    name = "proportional"
    axisymmetric = False

    def __post_init__(self) -> None:
        """Check the number of ratios. Raises InputError."""
        super().__post_init__()
        if len(self.ratios) not in (3, 6) or not np.any(self.ratios) or not np.isfinite(self.ratios).all():
            raise InputError(field="ratios", value=self.ratios, allowed="3 or 6 numbers, not all zero")

    def flow(self, accumulated: float) -> np.ndarray:
        x, y, z, yz, xz, xy = (*self.ratios, 0.0, 0.0, 0.0)[:6]
        return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])

    def strain_measure(self) -> StrainMeasure:
        return NORM

    def held(self) -> tuple[Held, ...]:
        direction = to_six(self.flow(0.0))
        across = np.linalg.svd(direction[None])[2][1:]  # the five directions in strain space normal to the path
        return (Held("ratios of the strains", "strain", across),)


def _tensors(name: str, values: object) -> tuple[float, ...]:
    """Convert k tensors (k, 3, 3), or a flat list of components, to 6 numbers per tensor: xx, yy, zz, yz, xz, xy."""
    array = np.asarray(values, dtype=float)
    if array.ndim > 1:
        return components_of(require_symmetric(name, array))
    if array.size == 3:  # normal components
        array = np.pad(array, (0, 3))
    if array.size % 6:
        raise InputError(f"has {array.size} numbers", field=name, allowed="xx,yy,zz,yz,xz,xy for each tensor")
    return tuple(array.tolist())


@dataclasses.dataclass(frozen=True, init=False)
class Mixed(Path):
    """Any mixed control with constant coefficients: up to six conditions on stresses and strain rates.

        D = strain_rate + sum_j x_j free_j      measured_i : sigma = target_i

    Each tensor is stored, and may also be given, as 6 numbers: xx, yy, zz, yz, xz, xy. Raises InputError for tensors
    that are not symmetric and shapes that do not match.

    Args:
        strain_rate: Prescribed part divided by `rate`, (3, 3).
        free: Strain rates that the servo adjusts, (k, 3, 3).
        measured: Coefficients of the held stresses, (k, 3, 3).
        target: Held stresses, (k,), Pa.
        strain: Accumulated strain at which the path ends.
        rate: Strain rate by which `strain_rate` is multiplied, 1/s.
    """

    strain: Number[float] = parameter(0.1, above=0.0, high=50.0, help="accumulated strain at which the path ends")
    strain_rate: Numbers = parameter((0.0,) * 6, help="prescribed strain rates divided by `rate`: xx,yy,zz,yz,xz,xy")
    free: Numbers = parameter((), help="strain rates that the servo adjusts: 6 numbers for each held stress")
    measured: Numbers = parameter(
        (),
        help="coefficients of each held stress: 6 numbers; each shear coefficient applies to both symmetric components",
    )
    target: Numbers = parameter((), unit="Pa", help="held stresses")

    name = "mixed"
    rate_limit = 8.0

    def __init__(
        self,
        strain_rate: ArrayLike = (0.0,) * 6,
        free: ArrayLike = (),
        measured: ArrayLike = (),
        target: ArrayLike = (),
        strain: float = 0.1,
        rate: float | None = None,
    ) -> None:
        """Check and convert the fields. Raises InputError."""
        fields = {"strain_rate": strain_rate, "free": free, "measured": measured, "target": target}
        for name, value in {**fields, "strain": strain, "rate": rate}.items():
            object.__setattr__(self, name, value)
        self.__post_init__()

    def __post_init__(self) -> None:
        """Check and convert the fields. Raises InputError."""
        for name in ("strain_rate", "free", "measured", "target"):
            if isinstance(getattr(self, name), str):  # text from the command line or a campaign
                object.__setattr__(self, name, parameters_of(Mixed)[name].read(getattr(self, name)))
        for name in ("strain_rate", "free", "measured"):
            object.__setattr__(self, name, _tensors(name, getattr(self, name)))
        target = np.atleast_1d(np.asarray(self.target, dtype=float))
        if not np.isfinite(target).all():
            raise InputError("target has a value that is not finite: give stresses in Pa")
        object.__setattr__(self, "target", tuple(target.tolist()))
        for name in ("free", "measured"):
            number = len(getattr(self, name)) // 6
            if number != len(self.target):
                raise InputError(
                    f"{name} has {number} tensors for {len(self.target)} targets: give one tensor per target"
                )
        super().__post_init__()

    def flow(self, accumulated: float) -> np.ndarray:
        return tensors_of(self.strain_rate)[0]

    def strain_measure(self) -> StrainMeasure:
        return NORM

    def control(self) -> Control | None:
        return Control(tensors_of(self.measured), tensors_of(self.free), self.target) if self.target else None
