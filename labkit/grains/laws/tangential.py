"""Tangential parts: springs with a slider, |ft| <= mu |fn|."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from labkit.grains.laws.contact import Contact, ContactStep, Values
from labkit.grains.laws.kinematics import Kinematics
from labkit.grains.laws.normal import POISSON_RATIO
from labkit.grains.laws.parts import Column, LawPart
from labkit.grains.laws.vectors import ZERO, Vector, cap, choose, dot
from labkit.grains.laws.yade import COHESION_MOMENT, MINDLIN, InYade
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.scene import Scene

TANGENTIAL_FORCE = Column("N", "tangential contact force on the first grain", size=3, odd=True)

FRICTION = parameter(0.4, low=0.0, high=10.0, help="friction coefficient mu")
STIFFNESS_RATIO = parameter(
    2.0, low=0.1, high=100.0, help="stiffness ratio kappa = kn/kt of the laws with linear springs"
)


class Coulomb(LawPart):
    """Tangential spring d ft = kt d u with kt = kn/kappa (Eq. 2)."""

    kind = "tangential"
    parameters: ClassVar[Mapping[str, object]] = {"friction": FRICTION, "stiffness_ratio": STIFFNESS_RATIO}
    history: ClassVar[Mapping[str, Column]] = {"tangential_force": TANGENTIAL_FORCE}
    losses: ClassVar[Mapping[str, str]] = {"friction_loss": "energy dissipated by sliding"}

    def acts(self, scene: Scene) -> bool:
        return scene.friction > 0.0

    def share(self, scene: Scene) -> float:
        """Return the argument `share` of `stiffness`, here kt/kn."""
        return 1.0 / scene.stiffness_ratio

    @staticmethod
    def stiffness(share: float, coefficient: float, overlap: float) -> float:
        """Return the tangential stiffness kt (N/m) from the coefficient of the normal part."""
        return share * coefficient

    @staticmethod
    def divisor(kt: float) -> float:
        """Return kt, or 1 where kt is 0 and nothing slips."""
        return kt

    @staticmethod
    def earlier(contact: Contact, dt: float) -> float:
        """Return the overlap (m) in the previous step; a constant stiffness does not need it."""
        return contact.overlap

    @staticmethod
    def rescale(x: Vector, overlap: float, earlier: float) -> Vector:
        """Rescale the force or moment of the previous step before the increment of this step; overlaps in m."""
        return x

    @staticmethod
    def loss(slid: float, before: float, share: float, step: ContactStep) -> float:
        """Return the energy (J) dissipated in a step.

        `slid` is |ft| times its excess over the limit, and `before` is ft^2 at the start of the step, both in N2.
        """
        return slid / step.kt


class CoulombOfYade(Coulomb):
    """The law of Coulomb; the compiler shares a division between its loss and the loss of RollingOfYade."""

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        """Return the part in YADE, where `poisson` = 1/kappa makes kt = kn/kappa exact."""
        poisson, angle = 1.0 / scene.stiffness_ratio, float(np.arctan(scene.friction))
        return InYade(
            COHESION_MOMENT, {"poisson": poisson, "frictionAngle": angle}, history={"tangential_force": "shearForce"}
        )

    @staticmethod
    def loss(slid: float, before: float, share: float, step: ContactStep) -> float:
        a, b = step.contact.radius_a, step.contact.radius_b
        return slid * (a * b * (1.0 / (step.kt * a * b)))


class Mindlin(Coulomb):
    """kt = kso sqrt(delta) with kso = 4 G sqrt(R*)/(2 - nu), G = E/(2 (1 + nu)): Mindlin's stiffness without microslip.

    A spring whose stiffness depends on delta has no potential: the work of ft depends on the order of normal and
    tangential loading. We take W = ft^2/(2 kt) for the stored energy, which is exact at constant delta. When delta
    changes at constant ft, W changes by -W d(delta)/(2 delta) although no work is done in the tangential direction.
    This energy, dissipated in loading and created in unloading, is included in the friction loss, which closes the
    energy balance. In closed cycles it is a property of the law, not of the integration (Elata and Berryman 1996). A
    rolling spring, whose kr is proportional to kt, is treated in the same way.
    """

    parameters: ClassVar[Mapping[str, object]] = {"friction": FRICTION, "poisson_ratio": POISSON_RATIO}

    def share(self, scene: Scene) -> float:
        """Return the argument `share` of `stiffness`: kso/kno = 3 (1 - nu)/(2 - nu)."""
        return 3.0 * (1.0 - scene.poisson_ratio) / (2.0 - scene.poisson_ratio)

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        angle = float(np.arctan(scene.friction))
        return InYade(MINDLIN, {"frictionAngle": angle}, history={"tangential_force": "shearElastic"})

    @staticmethod
    def stiffness(share: float, coefficient: float, overlap: float) -> float:
        return share * coefficient * np.sqrt(overlap)

    @staticmethod
    def divisor(kt: float) -> float:
        return choose(kt > 0.0, kt, 1.0)

    @staticmethod
    def earlier(contact: Contact, dt: float) -> float:
        branch = contact.branch - dt * contact.velocity
        return contact.radius_a + contact.radius_b - math.sqrt(dot(branch, branch))

    @staticmethod
    def loss(slid: float, before: float, share: float, step: ContactStep) -> float:
        """Return the energy (J) dissipated in a step, including all stored energy if the contact opens."""
        kt, kt_before = step.kt, share * step.contact.stiffness * math.sqrt(max(step.earlier, 0.0))
        lost = 0.5 * before / kt_before if kt_before > 0.0 else 0.0
        lost = lost - (0.5 * before / kt if kt > 0.0 else 0.0) if lost > 0.0 else 0.0
        return lost + (slid / kt if kt > 0.0 else 0.0)


class RescaledMindlin(Mindlin):
    """Mindlin's stiffness with ft reduced in proportion to kt while the normal force falls (Thornton et al. 2013).

    The stored energy W = ft^2/(2 kt) then falls with kt, too, so no energy is created in unloading. The moment of a
    rolling or twisting part is reduced in the same way.
    """

    @staticmethod
    def earlier(contact: Contact, dt: float) -> float:
        return contact.overlap + dt * dot(contact.normal, contact.velocity)

    @staticmethod
    def rescale(x: Vector, overlap: float, earlier: float) -> Vector:
        return math.sqrt(overlap / earlier if earlier > overlap else 1.0) * x

    @staticmethod
    def loss(slid: float, before: float, share: float, step: ContactStep) -> float:
        """Return the energy (J) dissipated in a step, including the loss due to a change of kt."""
        kt, kt_before = step.kt, share * step.contact.stiffness * math.sqrt(max(step.earlier, 0.0))
        lost = 0.5 * before / kt_before if kt_before > 0.0 else 0.0
        fallen = step.wide / step.earlier if step.earlier > step.wide else 1.0
        return lost - (0.5 * fallen * before / kt if kt > 0.0 else 0.0) + (slid / kt if kt > 0.0 else 0.0)


class TangentialForces(NamedTuple):
    """The tangential spring of a contact in a step.

    Args:
        force: Force of the spring on grain a (N).
        scale: 1 for a contact that sticks, less for one that slides, 0 without friction.
        history: Columns of history of the tangential part.
        losses: Losses of the tangential part (J).
    """

    force: Vector
    scale: float
    history: tuple[Vector, ...]
    losses: tuple[float, ...]


def compose_tangential_forces(
    kinematics: Kinematics, tangential: Coulomb, whole: bool, jumps: bool
) -> Callable[..., TangentialForces]:
    """Return `tangential_forces`, which returns the TangentialForces of a contact with friction (Eq. 2).

    The friction loss is the slip times the force after the step; if forces `jump` because grains join, part or break
    a bond, it is the slip times the mean of the forces before and after the step, which is second order.
    """
    carry, rescale, lost = kinematics.carry, tangential.rescale, tangential.loss

    def tangential_forces(
        step: ContactStep, history: Values, numbers: Values, moment_squared: float, ct: float
    ) -> TangentialForces:
        contact, motion = step.contact, step.motion
        t = carry(history.tangential_force, contact.normal, motion)
        start, before = dot(t, t) + moment_squared, t
        t = rescale(t, step.wide, step.earlier) + step.kt * step.dt * motion.slip
        squared = dot(t, t)
        limited = t + ct * motion.slip if whole else t
        scale = cap(dot(limited, limited), numbers.friction * step.limiting)
        slid = (1.0 - scale) * scale * squared
        if jumps:
            slid = 0.5 * (slid + (1.0 - scale) * dot(before, t))
        loss = lost(slid, start, numbers.shear, step)
        return TangentialForces(scale * t, scale, (scale * t,), (loss,))

    return tangential_forces


def no_tangential_forces(
    step: ContactStep, history: Values, numbers: Values, moment_squared: float, ct: float
) -> TangentialForces:
    """Return the TangentialForces of a contact without friction."""
    return TangentialForces(ZERO, 0.0, (), ())
