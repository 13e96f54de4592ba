"""Damping parts, which dissipate energy in addition to sliding."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from labkit.grains.laws.parts import LawPart, Numbers
from labkit.grains.laws.yade import MINDLIN, InYade, YadeClass
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.laws.normal import NormalForces
    from labkit.grains.scene import Scene

STIFFEST = 3.4  # damping ratio of the stiffest mode / damping ratio of one contact; a grain has several contacts

LOCAL_DAMPING = parameter(
    0.2, low=0.0, high=0.99, help="local non-viscous damping coefficient, with the laws of YADE without dashpots"
)
BETA_N, BETA_T = (
    parameter(0.2, low=0.0, high=10.0, help=f"damping ratio of the {dashpot} dashpot, with the laws that have dashpots")
    for dashpot in ("normal", "tangential")
)
LIMITS = parameter(
    "springs",
    choices=("springs", "forces"),
    help="what the friction coefficients limit: the forces of the springs, or those with their dashpots, with the "
    "spring-dashpot laws",
)


class Dashpots(LawPart):
    """Dashpots c = 2 beta sqrt(m* k), m* = ma mb/(ma + mb), parallel to the normal and tangential springs (Eqs. 1, 2).

    They act as long as the grains overlap: two grains in a head-on collision separate at exp(-pi beta/sqrt(1 - beta^2))
    times their approach speed, and the normal force may become slightly tensile just before separation. The limits of
    Eqs. 2 and 3 apply to the springs, or, with `limits` = "forces", to the sum of spring and dashpot forces.
    """

    kind = "damping"
    parameters: ClassVar[Mapping[str, object]] = {"beta_n": BETA_N, "beta_t": BETA_T, "limits": LIMITS}
    losses: ClassVar[Mapping[str, str]] = {"damping_loss": "energy dissipated by local damping or dashpots"}

    def acts(self, scene: Scene) -> bool:
        return not scene.beta_n == scene.beta_t == 0.0

    def local(self, scene: Scene) -> float | None:
        """Return the coefficient of local damping, or None without local damping."""
        return None

    def numbers(self, scene: Scene) -> Numbers:
        """Return (2 beta_n, 2 beta_t, density 4/3 pi), the argument `numbers` of `coefficients`."""
        return 2.0 * scene.beta_n, 2.0 * scene.beta_t, scene.mass(1.0)

    def ratio(self, scene: Scene) -> float:
        """Return the damping ratio of the stiffest mode of a specimen, which reduces the stable time step."""
        return STIFFEST * max(scene.beta_n, scene.beta_t)

    @staticmethod
    def coefficients(
        numbers: Numbers, share: float, normal: float, tangential: float, overlap: float
    ) -> tuple[float, float]:
        """Return the dashpot coefficients (cn, ct), in N s/m.

        Args:
            numbers: See the method `numbers`.
            share: kt/kn.
            normal: m* kn (kg N/m).
            tangential: m* kt (kg N/m).
            overlap: Overlap (m), negative for grains that are apart.
        """
        root = (1.0 if overlap >= 0.0 else 0.0) * math.sqrt(normal)
        return numbers[0] * root, numbers[1] * math.sqrt(share) * root

    @staticmethod
    def total_force(elastic: float, viscous: float) -> float:
        """Return the normal force (N) from the forces of spring and dashpot."""
        return elastic + viscous

    @staticmethod
    def limiting_force(elastic: float, total: float) -> float:
        """Return the normal force (N) that limits friction and rolling, if the limits apply to the springs."""
        return elastic

    @staticmethod
    def tangential_coefficient(ct: float, scale: float) -> float:
        """Return the tangential dashpot coefficient (N s/m); `scale` is 1 if the contact sticks, less if it slides."""
        return ct

    @staticmethod
    def loss(normal: NormalForces, ct: float, approach: float, squared: float, dt: float) -> float:
        """Return the energy (J) dissipated in a step; `squared` is the square of the slip velocity (m2/s2)."""
        return dt * (normal.cn * approach * approach + ct * squared)


class LocalDamping(Dashpots):
    """YADE's local non-viscous damping of the motion of grains, `local_damping`, and no dashpots."""

    parameters: ClassVar[Mapping[str, object]] = {"local_damping": LOCAL_DAMPING}

    def local(self, scene: Scene) -> float | None:
        return scene.local_damping or None

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        return InYade(None)

    def acts(self, scene: Scene) -> bool:
        return False  # it acts on grains, not on contacts


class DashpotsOfYade(Dashpots):
    """The dashpots betan and betas of YADE's Hertz-Mindlin law.

    The coefficient of restitution does not depend on the speed, because k is the tangent stiffness. The total normal
    force is never tensile, friction is limited by mu times the total normal force, and a sliding contact has no
    tangential dashpot. Records and stresses contain the spring forces only; YADE includes the dashpots in the stress
    that the servo uses.
    """

    parameters: ClassVar[Mapping[str, object]] = {"beta_n": BETA_N, "beta_t": BETA_T}

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        ratios = {"betan": scene.beta_n, "betas": scene.beta_t} if self.acts(scene) else {}
        values = {name: YadeClass("MatchMaker", {"algo": "val", "val": ratio}) for name, ratio in ratios.items()}
        return InYade(MINDLIN, physics=values)

    @staticmethod
    def coefficients(
        numbers: Numbers, share: float, normal: float, tangential: float, overlap: float
    ) -> tuple[float, float]:
        return numbers[0] * math.sqrt(normal), numbers[1] * math.sqrt(tangential)

    @staticmethod
    def total_force(elastic: float, viscous: float) -> float:
        return max(elastic + viscous, 0.0)

    @staticmethod
    def limiting_force(elastic: float, total: float) -> float:
        return total

    @staticmethod
    def tangential_coefficient(ct: float, scale: float) -> float:
        return ct if scale == 1.0 else 0.0

    @staticmethod
    def loss(normal: NormalForces, ct: float, approach: float, squared: float, dt: float) -> float:
        return dt * (normal.force - normal.elastic) * approach + dt * ct * squared
