"""Normal parts: the elastic force of two overlapping grains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labkit.grains.laws.parts import LawPart

if TYPE_CHECKING:
    from labkit.grains.scene import Scene


class LinearSpring(LawPart):
    """fn = kn delta with kn = (pi/2) E D* = pi E Ra Rb/(Ra + Rb) (Eq. 1 and below Eq. 3)."""

    kind = "normal"
    central = True

    def factor(self, scene: Scene) -> float:
        """First argument of `stiffness`, here pi E."""
        return float(np.pi * scene.young_modulus)

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Coefficient of two grains, here kn, N/m."""
        return factor * radius_a * radius_b / (radius_a + radius_b)

    @staticmethod
    def force(stiffness: float, overlap: float) -> float:
        """Elastic normal force of touching grains, N, compression positive; overlap >= 0, m."""
        return stiffness * overlap

    @staticmethod
    def energy(stiffness: float, overlap: float, shear: float = 0.0) -> float:
        """Stored energy, J, whose derivative is `force`.

        With shear = ft^2 kn/kt, N2, it includes the energy of a tangential spring of the stiffness kt = kn/kappa.
        """
        force = stiffness * overlap
        return 0.5 * ((force * force + shear) / stiffness)

    @staticmethod
    def tangent(stiffness: float, overlap: float, mass: float = 1.0) -> float:
        """Derivative of `force`, N/m, times a mass, kg."""
        return mass * stiffness


class SpringsInSeries(LinearSpring):
    """The linear spring of PFC, two elastic bars in series: kn = E area/length = pi E min(Ra, Rb)^2/(Ra + Rb).

    It equals the spring of Eq. 1 for equal grains, and is softer by min(R)/max(R) for others. YADE has no such functor:
    its kn is a function of Ea Ra and Eb Rb, which cannot contain the smaller of two radii.
    """

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """The coefficient of two grains, kn, N/m."""
        smaller = np.minimum(radius_a, radius_b)
        return factor * (smaller * smaller) / (radius_a + radius_b)


class HertzSpring(LinearSpring):
    """fn = kno delta^(3/2) with kno = 4/3 E* sqrt(R*), E* = E/(2 (1 - nu^2)), R* = Ra Rb/(Ra + Rb) (Hertz)."""

    uses = ("poisson_ratio",)

    def factor(self, scene: Scene) -> float:
        """The first argument of `stiffness`: 4/3 E*."""
        return 2.0 / 3.0 * scene.young_modulus / (1.0 - scene.poisson_ratio**2)

    @staticmethod
    def stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """The coefficient of two grains, kno, N/m^(3/2)."""
        return factor * np.sqrt(radius_a * radius_b / (radius_a + radius_b))

    @staticmethod
    def force(stiffness: float, overlap: float) -> float:
        return stiffness * overlap * np.sqrt(overlap)

    @staticmethod
    def energy(stiffness: float, overlap: float, shear: float = 0.0) -> float:
        return 0.4 * (stiffness * overlap * np.sqrt(overlap)) * overlap

    @staticmethod
    def tangent(stiffness: float, overlap: float, mass: float = 1.0) -> float:
        return 1.5 * mass * stiffness * np.sqrt(overlap)
