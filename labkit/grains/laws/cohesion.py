"""Cohesion parts: the attraction between two grains joined by adhesion, by a neck or by a capillary bridge.

Two grains join when they touch, and part when the gap between them reaches `gap`; until then they attract each other
across the gap. Whether two grains are joined is therefore part of the history of their contact. When they join or part,
the stored energy jumps while the grains stay in place: this jump is the breaking loss in the energy balance. The force
jumps with it, between two instants of a time step, and does half of the work that it would do over the whole step: the
jump of the energy is taken at the middle of the step, which makes the balance second order in the time step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from labkit.grains.laws.contact import Contact, Values
from labkit.grains.laws.parts import BREAKING, Column, LawPart, Numbers
from labkit.grains.laws.vectors import choose, dot
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.laws.tangential import Coulomb
    from labkit.grains.scene import Scene

TWO_PI, EIGHT_PI, THIRD = 2.0 * math.pi, 8.0 * math.pi, 1.0 / 3.0
LEAST = -1.5 * 2.0**THIRD  # R* delta/(q^2/8)^(2/3) at which the quartic of JKR loses its real roots

MEANING = "1 where adhesion, a neck or a capillary bridge joins the grains, else 0"
JOINED = Column("1", MEANING, joins=True, range=(1.0, 1.0))


class Adhesion(LawPart):
    """DMT: a constant attraction 2 pi W R* while the grains touch (Derjaguin, Muller and Toporov 1975).

    W, `adhesion_energy`, is the work of adhesion per unit area, which is twice the surface energy of one grain, and
    R* = Ra Rb/(Ra + Rb). The pull-off force is 2 pi W R*; friction is limited by mu times the elastic force, that is,
    by mu (fn + 2 pi W R*). YADE's Mindlin functor takes |fn| in place of fn: a contact that is pulled apart then holds
    the more shear, the harder it is pulled.
    """

    kind = "cohesion"
    parameters: ClassVar[Mapping[str, object]] = {
        "adhesion_energy": parameter(
            0.05, above=0.0, high=1e6, help="work of adhesion W per area, J/m2, with the laws dmt and jkr"
        )
    }
    history: ClassVar[Mapping[str, Column]] = {"joined": JOINED}
    losses: ClassVar[Mapping[str, str]] = BREAKING
    central = True
    not_in_yade = "its friction with adhesion is limited by mu (|fn| + 2 pi W R*), in tension, too"

    def numbers(self, scene: Scene) -> Numbers:
        """Return (2 pi W,), the argument `numbers` of the functions below."""
        return (TWO_PI * scene.adhesion_energy,)

    def begin(self, overlap: np.ndarray) -> dict[str, np.ndarray]:
        return {"joined": 1.0 * (overlap >= 0.0)}

    def reach(self, scene: Scene, stiffness: float, radius: float) -> float:
        return float(self.gap(self.numbers(scene), stiffness, radius, radius))

    @staticmethod
    def gap(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float) -> float:
        """Return the gap (m) at which two joined grains part; `stiffness` is the coefficient of the normal part."""
        return 0.0

    @staticmethod
    def force(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        """Return the force (N) between two joined grains that is added to the force of the normal part.

        It is negative if the grains attract each other. The overlap (m) is negative if there is a gap.
        """
        return -numbers[0] * (radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def energy(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        """Return the energy (J) whose derivative with respect to the overlap is `force`; zero for separated grains."""
        return -numbers[0] * (radius_a * radius_b / (radius_a + radius_b)) * overlap

    @property
    def normal_force(self) -> Callable[..., float]:
        """Function (contact, history, numbers) that returns the cohesive force (N); zero for grains not joined."""
        force = self.force

        def normal_force(contact: Contact, history: Values, numbers: Numbers) -> float:
            a, b = contact.radius_a, contact.radius_b
            return choose(history.joined != 0.0, force(numbers, contact.stiffness, a, b, contact.overlap), 0.0)

        return normal_force

    @property
    def stored_energy(self) -> Callable[..., float]:
        """Function (contact, history, numbers) that returns the cohesive energy (J); zero for grains not joined."""
        energy = self.energy

        def stored_energy(contact: Contact, history: Values, numbers: Numbers) -> float:
            a, b = contact.radius_a, contact.radius_b
            return history.joined * energy(numbers, contact.stiffness, a, b, contact.overlap)

        return stored_energy

    @staticmethod
    def limiting_force(numbers: Numbers, force: float, radius_a: float, radius_b: float) -> float:
        """Return the addition (N) to the normal force that limits friction of joined grains."""
        return 0.0

    @staticmethod
    def equivalent(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        """Return the overlap (m) at which grains without cohesion have the same tangential stiffness."""
        return np.maximum(overlap, 0.0)


class Neck(Adhesion):
    """JKR: a Hertz contact with surface energy and a neck that can span a gap (Johnson, Kendall and Roberts 1971).

    With the radius a of the contact area and E* of the Hertz spring,

        P = 4 E* a^3/(3 R*) - sqrt(8 pi W E* a^3),    delta = a^2/R* - sqrt(2 pi W a/E*).

    The pull-off force is 3/2 pi W R*. The grains join at delta = 0, where P = -4/3 pi W R*, and part at
    delta = -3/4 (R* c^4/4)^(1/3) with c^2 = 2 pi W/E*. As long as they are joined, even across a gap, the
    tangential stiffness is 8 G* a, and friction is limited by mu (P + 3 pi W R*) (Thornton and Yin 1991, without
    peeling, that is, without a reduction of a by the tangential force). The normal part must be a HertzSpring.
    """

    not_in_yade = "it has no JKR"

    def numbers(self, scene: Scene) -> Numbers:
        """Return (W,), the argument `numbers` of the functions below."""
        return (scene.adhesion_energy,)

    @staticmethod
    def gap(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float) -> float:
        radius = radius_a * radius_b / (radius_a + radius_b)
        squared = TWO_PI * numbers[0] / (0.75 * stiffness / np.sqrt(radius))
        return 0.75 * (0.25 * radius * squared * squared) ** THIRD

    @staticmethod
    def force(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        radius, hertz = radius_a * radius_b / (radius_a + radius_b), np.maximum(overlap, 0.0)
        modulus = 0.75 * stiffness / np.sqrt(radius)
        a = contact_radius(numbers[0], modulus, radius, overlap)
        pressed = 4.0 * modulus * a * a * a / (3.0 * radius) - stiffness * hertz * np.sqrt(hertz)
        return pressed - np.sqrt(EIGHT_PI * numbers[0] * modulus * a * a * a)

    @staticmethod
    def energy(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        radius, hertz = radius_a * radius_b / (radius_a + radius_b), np.maximum(overlap, 0.0)
        work, modulus = numbers[0], 0.75 * stiffness / np.sqrt(radius)
        a = contact_radius(work, modulus, radius, overlap)
        c, k1, k2 = np.sqrt(TWO_PI * work / modulus), 4.0 * modulus / (3.0 * radius), np.sqrt(EIGHT_PI * work * modulus)
        mixed = (k1 * c + 4.0 * k2 / radius) * np.sqrt(a) * a / 7.0
        return (
            a * a * (0.4 * k1 / radius * a * a * a - mixed + 0.5 * TWO_PI * work)
            - 0.4 * (stiffness * hertz * np.sqrt(hertz)) * hertz
        )

    @staticmethod
    def limiting_force(numbers: Numbers, force: float, radius_a: float, radius_b: float) -> float:
        return force + 1.5 * TWO_PI * numbers[0] * (radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def equivalent(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        radius = radius_a * radius_b / (radius_a + radius_b)
        a = contact_radius(numbers[0], 0.75 * stiffness / np.sqrt(radius), radius, overlap)
        return a * a / radius


def contact_radius(work: float, modulus: float, radius: float, overlap: float) -> float:
    """Return the JKR contact radius a (m): the larger solution of delta = a^2/R* - sqrt(2 pi W a/E*).

    x = sqrt(a) solves a quartic, x^4 - q x - R* delta = 0 with q = R* sqrt(2 pi W/E*). Its resolvent cubic
    m^3 + R* delta m - q^2/8 = 0 has one positive root, which Newton's iteration approaches from above.

    Args:
        work: W (J/m2).
        modulus: E* (Pa).
        radius: R* (m).
        overlap: delta (m); not below the value at which the grains part.
    """
    q = radius * np.sqrt(TWO_PI * work / modulus)
    e = 0.125 * q * q
    top = e**THIRD
    y = np.maximum(radius * overlap, LEAST * top * top)  # not below the value at which the grains separate
    m = np.minimum(top, e / np.maximum(y, top * top)) + np.sqrt(np.maximum(-y, 0.0))
    for _ in range(7):
        m = (2.0 * m * m * m + e) / (3.0 * m * m + y)
    s = np.sqrt(2.0 * m)
    x = 0.5 * (s + np.sqrt(np.maximum(2.0 * q / s - s * s, 0.0)))
    return x * x


class Bridge(Adhesion):
    """A capillary bridge of constant volume V that forms when the grains touch and ruptures at a gap H_r.

        F = 2 pi gamma R cos(theta) (1 - H/sqrt(H^2 + 2 V/(pi R)))          (Rabinovich, Esayanur and Moudgil 2005)
        H_r = R (1 + theta/2) (V'^(1/3) + V'^(2/3)/10)                      (Willett, Adams, Johnson and Seville 2000)

    where H is the gap, zero for grains that overlap, R = 2 Ra Rb/(Ra + Rb), and V' = V/R^3 is `bridge_volume` for every
    pair. Gravity and viscosity of the liquid are neglected, the bridges of a grain do not merge, and a ruptured bridge
    forms again when the grains touch. The energy is zero when the grains just touch: the work of pulling a bridge apart
    is stored until it ruptures, and then dissipated.
    """

    not_in_yade = "its capillary law needs tables that it does not include"
    parameters: ClassVar[Mapping[str, object]] = {
        "surface_tension": parameter(
            0.072, above=0.0, high=1e3, help="surface tension of the liquid, N/m, with the law capillary"
        ),
        "contact_angle": parameter(
            0.0, low=0.0, high=89.0, help="contact angle of the liquid in degrees, with the law capillary"
        ),
        "bridge_volume": parameter(
            0.01,
            low=1e-9,
            high=0.3,
            help="volume of a capillary bridge over the cube of 2 Ra Rb/(Ra + Rb), with the law capillary",
        ),
    }

    def numbers(self, scene: Scene) -> Numbers:
        """Return (2 pi gamma cos(theta), 2 V'/pi, H_r/R), the argument `numbers` of the functions below."""
        angle, volume = math.radians(scene.contact_angle), scene.bridge_volume
        rupture = (1.0 + 0.5 * angle) * (volume**THIRD + 0.1 * volume ** (2.0 * THIRD))
        return TWO_PI * scene.surface_tension * math.cos(angle), 2.0 * volume / math.pi, rupture

    @staticmethod
    def gap(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float) -> float:
        return numbers[2] * (2.0 * radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def force(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        radius, gap = 2.0 * radius_a * radius_b / (radius_a + radius_b), np.maximum(-overlap, 0.0)
        return -numbers[0] * radius * (1.0 - gap / np.sqrt(gap * gap + numbers[1] * radius * radius))

    @staticmethod
    def energy(numbers: Numbers, stiffness: float, radius_a: float, radius_b: float, overlap: float) -> float:
        radius, gap = 2.0 * radius_a * radius_b / (radius_a + radius_b), np.maximum(-overlap, 0.0)
        liquid = numbers[1] * radius * radius
        pulled = gap - np.sqrt(gap * gap + liquid) + np.sqrt(liquid)
        return numbers[0] * radius * (pulled - np.maximum(overlap, 0.0))


class CohesiveForces(NamedTuple):
    """The effect of cohesion on a contact in a time step.

    Args:
        wide: Overlap (m) that determines the tangential stiffness.
        earlier: The same overlap (m) in the previous step.
        pull: Force (N) added to the force of the normal part; negative if the grains attract each other.
        limiting: Addition (N) to the normal force that limits friction.
        history: Columns of history of the cohesion part.
        losses: Losses of the cohesion part (J).
    """

    wide: float
    earlier: float
    pull: float
    limiting: float
    history: tuple[float, ...]
    losses: tuple[float, ...]


def compose_wide(cohesion: Adhesion | None) -> Callable[..., float]:
    """Return `wide(contact, history, numbers)`, which returns the overlap (m) for the tangential stiffness."""

    def touch(contact: Contact, history: Values, numbers: Values) -> float:
        return np.maximum(contact.overlap, 0.0)

    if cohesion is None:
        return touch
    equivalent = cohesion.equivalent

    def wide(contact: Contact, history: Values, numbers: Values) -> float:
        a, b = contact.radius_a, contact.radius_b
        width = equivalent(numbers.cohesion, contact.stiffness, a, b, contact.overlap)
        return choose(history.joined != 0.0, width, 0.0)

    return wide


def compose_cohesive_forces(tangential: Coulomb, cohesion: Adhesion | None) -> Callable[..., CohesiveForces]:
    """Return `cohesive_forces`, a function that returns the CohesiveForces of a contact."""
    overlap_before = tangential.earlier

    def no_cohesive_forces(contact: Contact, history: Values, numbers: Values, dt: float) -> CohesiveForces:
        wide = contact.overlap if contact.overlap >= 0.0 else 0.0
        return CohesiveForces(wide, overlap_before(contact, dt), 0.0, 0.0, (), ())

    if cohesion is None:
        return no_cohesive_forces
    gap, equivalent, limiting_force = cohesion.gap, cohesion.equivalent, cohesion.limiting_force
    force, energy = cohesion.force, cohesion.energy

    def cohesive_forces(contact: Contact, history: Values, numbers: Values, dt: float) -> CohesiveForces:
        k, ra, rb, before = contact.stiffness, contact.radius_a, contact.radius_b, history.joined
        earlier = overlap_before(contact, dt)
        still = before != 0.0 and contact.overlap > -gap(numbers.cohesion, k, ra, rb)
        joined = 1.0 if contact.overlap >= 0.0 or still else 0.0
        wide = joined * equivalent(numbers.cohesion, k, ra, rb, contact.overlap)
        closed = -dt * dot(contact.normal, contact.velocity)  # change of the overlap in this step
        last = choose(joined != 0.0, contact.overlap, contact.overlap - closed)  # at which the grains are joined
        pulling = force(numbers.cohesion, k, ra, rb, last)
        pull = joined * pulling
        limiting = joined * limiting_force(numbers.cohesion, pull, ra, rb)
        middle = energy(numbers.cohesion, k, ra, rb, last) - (joined - 0.5) * pulling * closed  # of the step
        lost = (abs(before) - joined) * middle
        return CohesiveForces(
            wide, equivalent(numbers.cohesion, k, ra, rb, earlier), pull, limiting, (joined,), (lost,)
        )

    return cohesive_forces
