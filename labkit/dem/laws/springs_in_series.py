"""The spring-dashpot law with the linear stiffness of PFC, that of two elastic bars in series.

    kn = E area/length = pi E min(Ra, Rb)^2/(Ra + Rb)        kt = kn/kappa        kr = kt r*^2

It equals the stiffness of Eqs. 1-3, pi E Ra Rb/(Ra + Rb), for equal grains, and is lower by min(R)/max(R) for others.
Everything else, f~, Lambda, C0, energies and losses included, is that of labkit.dem.laws.spring_dashpot with this kn.
YADE has no such functor: its kn is a function of Ea Ra and Eb Rb, which cannot contain the smaller of two radii.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labkit.dem.laws.spring_dashpot import SpringDashpot

if TYPE_CHECKING:
    from labkit.dem.scene import Scene


class SpringsInSeries(SpringDashpot):
    """Spring-dashpot law with the stiffness of PFC, pi E min(R)^2/(Ra + Rb)."""

    name = "springs_in_series"
    description = "spring-dashpot law with the stiffness of PFC"

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Normal stiffness kn = pi E min(Ra, Rb)^2/(Ra + Rb), N/m."""
        if scene.planar:
            return super().normal_stiffness(scene, radius_a, radius_b)
        return np.pi * scene.young_modulus * np.minimum(radius_a, radius_b) ** 2 / (radius_a + radius_b)
