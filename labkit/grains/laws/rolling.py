"""Rolling and twisting parts: springs with a slider that resist relative rotation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from labkit.grains.laws.contact import Contact, ContactStep, Values
from labkit.grains.laws.kinematics import Kinematics
from labkit.grains.laws.parts import Column, LawPart, Numbers
from labkit.grains.laws.vectors import ZERO, Vector, across, cap, dot
from labkit.grains.laws.yade import COHESION_MOMENT, InYade
from labkit.parameters import parameter

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw
    from labkit.grains.laws.tangential import Coulomb
    from labkit.grains.scene import Scene

ROLLING_MOMENT = Column("N m", "rolling resistance moment on the first grain", size=3, odd=True)

ROLLING_FRICTION = parameter(0.1, low=0.0, high=10.0, help="rolling friction coefficient mu_r")
ROLLING_LIMIT_SCALE = parameter(
    1.0, low=0.0, high=10.0, help="factor on the rolling limit of the rolling_resistance law"
)
TWISTING_FRICTION = parameter(
    0.0, low=0.0, high=10.0, help="twisting friction coefficient, with the laws that have rolling friction"
)


class Rolling(LawPart):
    """Rolling spring kr = kt r*^2 with |M| <= mu_r r* |fn|, where r* = Ra Rb/(Ra + Rb) (Eq. 3)."""

    kind = "rolling"
    parameters: ClassVar[Mapping[str, object]] = {"rolling_friction": ROLLING_FRICTION}
    history: ClassVar[Mapping[str, Column]] = {"rolling_moment": ROLLING_MOMENT}
    losses: ClassVar[Mapping[str, str]] = {"rolling_loss": "energy dissipated by rolling at the moment limit"}

    def friction(self, scene: Scene) -> float:
        """Return the coefficient of rolling friction mu_r."""
        return scene.rolling_friction

    def acts(self, scene: Scene) -> bool:
        return self.friction(scene) > 0.0

    def numbers(self, scene: Scene) -> Numbers:
        """Return (mu_r,), the argument `numbers` of the functions below."""
        return (self.friction(scene),)

    @staticmethod
    def stiffness(numbers: Numbers, kt: float, radius_a: float, radius_b: float) -> float:
        """Return the stiffness kr (N m) from kt (N/m)."""
        reduced = radius_a * radius_b / (radius_a + radius_b)
        return kt * reduced * reduced

    @staticmethod
    def limit(numbers: Numbers, radius_a: float, radius_b: float) -> float:
        """Return the ratio (m) of the largest moment to the normal force."""
        return numbers[0] * (radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def loss(slid: float, numbers: Numbers, stiffness: float, kt: float, radius_a: float, radius_b: float) -> float:
        """Return the energy (J) dissipated in a step; `slid` is |M| times its excess over the limit, N2 m2."""
        return slid / stiffness if stiffness > 0.0 else 0.0


class Twisting(Rolling):
    """A spring like Rolling about the contact normal: |Mt| <= mu_t r* |fn|.

    Its moment Mt is stored as the normal component of the rolling moment.
    """

    kind = "twisting"
    parameters: ClassVar[Mapping[str, object]] = {"twisting_friction": TWISTING_FRICTION}

    def friction(self, scene: Scene) -> float:
        """Return the coefficient of twisting friction mu_t."""
        return scene.twisting_friction


class RollingOfYade(Rolling):
    """YADE's rolling spring kr = kt Ra Rb/4 with |M| <= mu_r/2 min(Ra, Rb) fn times `rolling_limit_scale`."""

    parameters: ClassVar[Mapping[str, object]] = {**Rolling.parameters, "rolling_limit_scale": ROLLING_LIMIT_SCALE}

    def numbers(self, scene: Scene) -> Numbers:
        """Return YADE's (alphaKr, etaRoll)."""
        return 0.25, 0.5 * scene.rolling_limit_scale * self.friction(scene)

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        alpha, eta = self.numbers(scene)
        material = {"momentRotationLaw": self.acts(scene), "alphaKr": alpha, "etaRoll": eta}
        return InYade(COHESION_MOMENT, material, history={"rolling_moment": "moment_bending"})

    @staticmethod
    def stiffness(numbers: Numbers, kt: float, radius_a: float, radius_b: float) -> float:
        return numbers[0] * radius_a * radius_b * kt

    @staticmethod
    def limit(numbers: Numbers, radius_a: float, radius_b: float) -> float:
        return numbers[1] * np.minimum(radius_a, radius_b)

    @staticmethod
    def loss(slid: float, numbers: Numbers, stiffness: float, kt: float, radius_a: float, radius_b: float) -> float:
        return slid * (1.0 / (kt * radius_a * radius_b) / numbers[0])


class TwistingOfYade(RollingOfYade):
    """A spring like RollingOfYade about the contact normal, with YADE's (alphaKtw, etaTwist)."""

    kind = "twisting"
    parameters: ClassVar[Mapping[str, object]] = {**Twisting.parameters, "rolling_limit_scale": ROLLING_LIMIT_SCALE}
    friction = Twisting.friction

    def yade(self, scene: Scene, radius: float) -> InYade | None:
        """Return None with twisting resistance, because labkit's has not been compared with YADE's."""
        return None if self.acts(scene) else InYade(COHESION_MOMENT)


class Moments(NamedTuple):
    """The rolling and twisting springs of a contact in a step.

    Args:
        moment: Moment on grain a (N m).
        history: Columns of history of these parts.
        losses: Losses of these parts (J).
    """

    moment: Vector
    history: tuple[Vector, ...]
    losses: tuple[float, ...]


def compose_moment_squared(law: ContactLaw, parts: Mapping[str, LawPart]) -> Callable[..., float]:
    """Return `moment_squared`, which returns M^2 kt/kr of the springs, N2; the normal is `before`."""
    roll_stiffness, twist_stiffness = law.rolling.stiffness, law.twisting.stiffness

    def not_at_all(contact: Contact, before: Vector, history: Values, numbers: Values) -> float:
        return 0.0

    def twists(contact: Contact, before: Vector, history: Values, numbers: Values) -> float:
        ra, rb, m = contact.radius_a, contact.radius_b, history.rolling_moment
        return dot(m, m) / twist_stiffness(numbers.twisting, 1.0, ra, rb)

    def rolls(contact: Contact, before: Vector, history: Values, numbers: Values) -> float:
        ra, rb, m = contact.radius_a, contact.radius_b, history.rolling_moment
        return dot(m, m) / roll_stiffness(numbers.rolling, 1.0, ra, rb)

    def does_both(contact: Contact, before: Vector, history: Values, numbers: Values) -> float:
        ra, rb, m = contact.radius_a, contact.radius_b, history.rolling_moment
        kr, twist = roll_stiffness(numbers.rolling, 1.0, ra, rb), dot(m, before)
        twisting = twist * twist * (1.0 / twist_stiffness(numbers.twisting, 1.0, ra, rb) - 1.0 / kr)
        return dot(m, m) / kr + twisting

    if "rolling" in parts:
        return does_both if "twisting" in parts else rolls
    return twists if "twisting" in parts else not_at_all


def compose_moments(law: ContactLaw, parts: Mapping[str, LawPart]) -> Callable[..., Moments]:
    """Return `moments`, which returns the Moments of a contact from the rolling and twisting parts."""
    rolling, twisting, slides = "rolling" in parts, "twisting" in parts, "tangential" in parts
    roll, twist_by, rescale, lost = (
        compose_rolling(law.kinematics, law.rolling, law.tangential),
        compose_twisting(law.twisting, law.tangential),
        law.tangential.rescale,
        law.tangential.loss,
    )

    def no_moments(step: ContactStep, history: Values, numbers: Values, moment_squared: float) -> Moments:
        return Moments(ZERO, (), ())

    def moments(step: ContactStep, history: Values, numbers: Values, moment_squared: float) -> Moments:
        m, before = rescale(history.rolling_moment, step.wide, step.earlier), step.motion.before
        twist, loss = 0.0, 0.0
        if not slides:
            loss = lost(0.0, moment_squared, numbers.shear, step)
        if twisting:
            twist = dot(m, before)
            m = m - twist * before if rolling else ZERO
        if rolling:
            m, rolling_loss = roll(step, m, numbers)
            loss += rolling_loss
        if twisting:
            twisted, twisting_loss = twist_by(step, twist, numbers)
            loss += twisting_loss
            m += twisted * step.contact.normal
        return Moments(m, (m,), (loss,))

    return moments if rolling or twisting else no_moments


def compose_rolling(
    kinematics: Kinematics, rolling: Rolling, tangential: Coulomb
) -> Callable[..., tuple[Vector, float]]:
    """Return `roll`, which returns the rolling moment (N m) after a step and the energy dissipated (J), Eq. 3."""
    carry, stiffness, limit, lost, divisor = (
        kinematics.carry, rolling.stiffness, rolling.limit, rolling.loss, tangential.divisor,
    )  # fmt: skip

    def roll(step: ContactStep, m: Vector, numbers: Values) -> tuple[Vector, float]:
        contact, n, kt = step.contact, step.contact.normal, step.kt
        ra, rb = contact.radius_a, contact.radius_b
        m = carry(m, n, step.motion)
        kr = stiffness(numbers.rolling, kt, ra, rb)
        m += kr * step.dt * across(contact.spin_b - contact.spin_a, n)
        squared = dot(m, m)
        scale = cap(squared, limit(numbers.rolling, ra, rb) * step.limiting)
        return scale * m, lost((1.0 - scale) * scale * squared, numbers.rolling, kr, divisor(kt), ra, rb)

    return roll


def compose_twisting(twisting: Rolling, tangential: Coulomb) -> Callable[..., tuple[float, float]]:
    """Return `twist_by`, which returns the twisting moment (N m) after a step and the energy dissipated (J)."""
    stiffness, limit, lost, divisor = twisting.stiffness, twisting.limit, twisting.loss, tangential.divisor

    def twist_by(step: ContactStep, twist: float, numbers: Values) -> tuple[float, float]:
        contact, kt = step.contact, step.kt
        ra, rb = contact.radius_a, contact.radius_b
        kw = stiffness(numbers.twisting, kt, ra, rb)
        twist += kw * step.dt * dot(contact.spin_b - contact.spin_a, contact.normal)
        scale = cap(twist * twist, limit(numbers.twisting, ra, rb) * step.limiting)
        return scale * twist, lost((1.0 - scale) * scale * twist * twist, numbers.twisting, kw, divisor(kt), ra, rb)

    return twist_by
