"""The Hertz-Mindlin law of YADE with its viscous dashpots, betan and betas, instead of local damping.

    cn = 2 beta_n sqrt(m* kn)        ct = 2 beta_t sqrt(m* kt)        m* = ma mb/(ma + mb)

with the tangent stiffnesses kn and kt of labkit.dem.laws.hertz_mindlin, so that the restitution does not depend on the
speed. As in YADE, the total normal force is never tensile, friction is limited by mu times the total normal force, and
a sliding contact has no tangential dashpot. Records and stresses contain the springs only, as for `spring_dashpot`;
YADE includes the dashpots in the stress that the servo uses.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labkit.dem.laws.base import Features, Tangents
from labkit.dem.laws.hertz_mindlin import HertzMindlin
from labkit.dem.laws.spring_dashpot import STIFFEST_DAMPING

if TYPE_CHECKING:
    from labkit.dem.scene import Scene


class HertzMindlinDashpot(HertzMindlin):
    """Hertz-Mindlin law of YADE with dashpots and without local damping."""

    name = "hertz_mindlin_dashpot"
    description = "Hertz-Mindlin law of YADE with dashpots"

    def tangents(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> Tangents:
        springs = super().tangents(scene, radius_a, radius_b, overlap)
        a, b = scene.mass(radius_a), scene.mass(radius_b)
        reduced = a * b / (a + b)
        normal, tangential = (np.sqrt(reduced * k) for k in (springs.normal, springs.tangential))
        return springs._replace(
            normal_dashpot=2.0 * scene.beta_n * normal, tangential_dashpot=2.0 * scene.beta_t * tangential
        )

    def damping_ratio(self, scene: Scene) -> float:
        return STIFFEST_DAMPING * max(scene.beta_n, scene.beta_t)

    def features(self, scene: Scene) -> Features:
        """Friction and dashpots of the scene; dashpots: (2 beta_n, 2 beta_t, density 4/3 pi)."""
        dashpots = None
        if scene.beta_n > 0.0 or scene.beta_t > 0.0:
            dashpots = (2.0 * scene.beta_n, 2.0 * scene.beta_t, scene.mass(1.0))
        return super().features(scene)._replace(dashpots=dashpots, damping=None, turning=True)
