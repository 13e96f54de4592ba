"""The spring-dashpot law with the linear stiffness of PFC, that of two elastic bars in series.

    kn = E area/length = pi E min(Ra, Rb)^2/(Ra + Rb)        kt = kn/kappa        kr = kt r*^2

It equals the stiffness of Eqs. 1-3, pi E Ra Rb/(Ra + Rb), for equal grains, and is lower by min(R)/max(R) for others.
Everything else, f~, Lambda, C0, energies and losses included, is that of labkit.dem.laws.spring_dashpot with this kn.
YADE has no such functor: its kn is a function of Ea Ra and Eb Rb, which cannot contain the smaller of two radii.
"""

from __future__ import annotations

import numpy as np

from labkit.dem.laws.spring_dashpot import SpringDashpot


class SpringsInSeries(SpringDashpot):
    """Spring-dashpot law with the stiffness of PFC, pi E min(R)^2/(Ra + Rb)."""

    name = "springs_in_series"
    description = "spring-dashpot law with the stiffness of PFC"

    @staticmethod
    def pair_stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """Normal stiffness kn = pi E min(Ra, Rb)^2/(Ra + Rb), N/m; factor: pi E."""
        smaller = np.minimum(radius_a, radius_b)
        return factor * (smaller * smaller) / (radius_a + radius_b)
