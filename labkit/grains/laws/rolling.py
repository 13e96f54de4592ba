"""Rolling and twisting parts: springs against relative rotation with a slider."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from labkit.grains.laws.parts import Column, LawPart, Numbers

if TYPE_CHECKING:
    from labkit.grains.scene import Scene


ROLLING_MOMENT = Column("N m", "rolling resistance moment on the first grain", size=3, odd=True)


class Rolling(LawPart):
    """kr = kt r*^2 and |M| <= mu_r r* |fn| with r* = Ra Rb/(Ra + Rb) (Eq. 3)."""

    kind = "rolling"
    uses: ClassVar[tuple[str, ...]] = ("rolling_friction",)
    history: ClassVar[Mapping[str, Column]] = {"rolling_moment": ROLLING_MOMENT}
    losses = ("rolling_loss",)

    def friction(self, scene: Scene) -> float:
        """The coefficient mu_r."""
        return scene.rolling_friction

    def acts(self, scene: Scene) -> bool:
        return self.friction(scene) > 0.0

    def numbers(self, scene: Scene) -> Numbers:
        """First argument of the functions below: (mu_r,)."""
        return (self.friction(scene),)

    @staticmethod
    def stiffness(numbers: Numbers, kt: float, radius_a: float, radius_b: float) -> float:
        """Stiffness kr, N m, from kt, N/m."""
        reduced = radius_a * radius_b / (radius_a + radius_b)
        return kt * reduced * reduced

    @staticmethod
    def limit(numbers: Numbers, radius_a: float, radius_b: float) -> float:
        """Largest moment over the normal force, m."""
        return numbers[0] * (radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def loss(slid: float, numbers: Numbers, stiffness: float, kt: float, radius_a: float, radius_b: float) -> float:
        """Energy lost in a step, J; `slid` is |M| times the part of it that slips, N2 m2, and `stiffness` kr."""
        return slid / stiffness if stiffness > 0.0 else 0.0


class Twisting(Rolling):
    """The same spring against relative rotation about the contact normal: |Mt| <= mu_t r* |fn|.

    Its moment is stored as the normal component of the rolling moment.
    """

    kind = "twisting"
    uses = ("twisting_friction",)

    def friction(self, scene: Scene) -> float:
        """The coefficient mu_t."""
        return scene.twisting_friction


class RollingOfYade(Rolling):
    """kr = kt Ra Rb/4 and |M| <= mu_r/2 min(Ra, Rb) fn times `rolling_limit_scale`."""

    uses = ("rolling_friction", "rolling_limit_scale")

    def numbers(self, scene: Scene) -> Numbers:
        """YADE's (alphaKr, etaRoll)."""
        return 0.25, 0.5 * scene.rolling_limit_scale * self.friction(scene)

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
    """The same spring against relative rotation about the contact normal, with (alphaKtw, etaTwist)."""

    kind = "twisting"
    uses = ("twisting_friction", "rolling_limit_scale")
    friction = Twisting.friction
