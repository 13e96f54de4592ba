"""Normal parts: the elastic force of two overlapping grains."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from labkit.grains.laws.contact import Contact, Values
from labkit.grains.laws.parts import LawPart, Numbers
from labkit.grains.laws.vectors import Vector, dot
from labkit.grains.laws.yade import COHESION_MOMENT, MINDLIN, InYade
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.laws.damping import Dashpots
    from labkit.grains.scene import Scene


POISSON_RATIO = parameter(0.3, low=0.0, high=0.5, help="Poisson's ratio nu of the grains, with the Hertz-Mindlin laws")


class LinearSpring(LawPart):
    """fn = kn delta with kn = (pi/2) E D* = pi E Ra Rb/(Ra + Rb) (Eq. 1 and below Eq. 3)."""

    kind = "normal"
    central = True

    def factor(self, scene: Scene) -> float:
        """Return the argument `factor` of `stiffness`, here pi E."""
        return float(np.pi * scene.young_modulus)

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        """Return the part in YADE, where kn = 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb).

        With E = kn/R, where kn is the stiffness of two equal grains in labkit, both have the same kn. For spheres E is
        (pi/2) `young_modulus` for any radius.
        """
        return InYade(COHESION_MOMENT, {"young": float(scene.normal_stiffness(radius, radius)) / radius})

    respond: ClassVar[Callable[..., Forces]]  # only in parts with a history

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Return the coefficient of `force` for two grains, here kn (N/m)."""
        return factor * radius_a * radius_b / (radius_a + radius_b)

    @staticmethod
    def force(stiffness: float, overlap: float) -> float:
        """Return the elastic normal force (N) of touching grains, compression positive; the overlap (m) is >= 0."""
        return stiffness * overlap

    @staticmethod
    def energy(stiffness: float, overlap: float) -> float:
        """Return the stored energy (J) whose derivative is `force`."""
        force = stiffness * overlap
        return 0.5 * (force * force / stiffness)

    @property
    def normal_force(self) -> Callable[..., float]:
        """Function (contact, history, numbers) that returns the normal force (N)."""
        force = self.force

        def normal_force(contact: Contact, history: Values, numbers: Numbers) -> float:
            return force(contact.stiffness, np.maximum(contact.overlap, 0.0))

        return normal_force

    @property
    def stored_energy(self) -> Callable[..., float]:
        """Function (contact, history, numbers) that returns the stored energy (J)."""
        energy = self.energy

        def stored_energy(contact: Contact, history: Values, numbers: Numbers) -> float:
            return energy(contact.stiffness, np.maximum(contact.overlap, 0.0))

        return stored_energy

    @staticmethod
    def tangent(stiffness: float, overlap: float, mass: float = 1.0) -> float:
        """Return the derivative of `force` (N/m) times a mass (kg)."""
        return mass * stiffness


class SpringsInSeries(LinearSpring):
    """The linear spring of PFC, two elastic bars in series: kn = E area/length = pi E min(Ra, Rb)^2/(Ra + Rb).

    It equals the spring of Eq. 1 for equal grains and is softer by the factor min(R)/max(R) for unequal grains. YADE
    has no such functor: its kn depends on Ea Ra and Eb Rb in a way that cannot express the smaller of two radii.
    """

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Return the coefficient kn of two grains (N/m)."""
        smaller = np.minimum(radius_a, radius_b)
        return factor * (smaller * smaller) / (radius_a + radius_b)


class HertzSpring(LinearSpring):
    """fn = kno delta^(3/2) with kno = 4/3 E* sqrt(R*), E* = E/(2 (1 - nu^2)), R* = Ra Rb/(Ra + Rb) (Hertz)."""

    parameters: ClassVar[Mapping[str, object]] = {"poisson_ratio": POISSON_RATIO}

    def factor(self, scene: Scene) -> float:
        """Return the argument `factor` of `stiffness`: 4/3 E*."""
        return 2.0 / 3.0 * scene.young_modulus / (1.0 - scene.poisson_ratio**2)

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        return InYade(MINDLIN, {"young": scene.young_modulus, "poisson": scene.poisson_ratio})

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Return the coefficient kno of two grains, N/m^(3/2)."""
        return factor * np.sqrt(radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def force(stiffness: float, overlap: float) -> float:
        return stiffness * overlap * np.sqrt(overlap)

    @staticmethod
    def energy(stiffness: float, overlap: float) -> float:
        return 0.4 * (stiffness * overlap * np.sqrt(overlap)) * overlap

    @staticmethod
    def tangent(stiffness: float, overlap: float, mass: float = 1.0) -> float:
        return 1.5 * mass * stiffness * np.sqrt(overlap)


class NormalForces(NamedTuple):
    """The normal springs and dashpots of a contact in a step.

    Args:
        force: Force of spring and dashpot (N).
        limiting: Normal force (N) that limits friction and rolling, without the contribution of cohesion.
        elastic: Force of the spring (N).
        cn: Coefficient of the normal dashpot (N s/m).
        ct: Coefficient of the tangential dashpot (N s/m).
        history: Columns of history of the normal part.
        losses: Losses of the normal part (J).
    """

    force: float
    limiting: float
    elastic: float
    cn: float
    ct: float
    history: tuple[float | Vector, ...]
    losses: tuple[float, ...]


def compose_normal_forces(normal: LinearSpring, damping: Dashpots | None, whole: bool) -> Callable[..., NormalForces]:
    """Return `normal_forces`, a function that returns the NormalForces of a contact.

    A normal part with a history has a function `respond(contact, history, numbers)` that returns the force (N), the
    columns of history and the losses (J).
    """
    spring = normal.respond if normal.history else compose_spring(normal)

    def normal_forces(contact: Contact, history: Values, numbers: Values, kt: float) -> NormalForces:
        elastic, columns, losses = spring(contact, history, numbers.normal)
        return NormalForces(elastic, elastic, elastic, 0.0, 0.0, columns, losses)

    if damping is None:
        return normal_forces
    coefficients, tangent = damping.coefficients, normal.tangent
    total_force, limiting_force = damping.total_force, damping.limiting_force

    def normal_forces_with_dashpots(contact: Contact, history: Values, numbers: Values, kt: float) -> NormalForces:
        k, ra, rb, density = contact.stiffness, contact.radius_a, contact.radius_b, numbers.damping[2]
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        elastic, columns, losses = spring(contact, history, numbers.normal)
        ca, cb = density * ra * ra * ra, density * rb * rb * rb
        mass = ca * cb / (ca + cb)
        cn, ct = coefficients(numbers.damping, numbers.shear, tangent(k, depth, mass), mass * kt, contact.overlap)
        fn = total_force(elastic, cn * -dot(contact.normal, contact.velocity))
        return NormalForces(fn, fn if whole else limiting_force(elastic, fn), elastic, cn, ct, columns, losses)

    return normal_forces_with_dashpots


Forces = tuple[float, tuple[float | Vector, ...], tuple[float, ...]]  # force (N), columns of history and losses (J)


def compose_spring(normal: LinearSpring) -> Callable[..., Forces]:
    """Return `spring`, which returns the force (N) of a normal part without history, and no columns or losses."""
    force = normal.force

    def spring(
        contact: Contact, history: Values, numbers: Values
    ) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        return force(contact.stiffness, depth) if contact.overlap >= 0.0 else 0.0, (), ()

    return spring
