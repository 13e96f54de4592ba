"""The spring-dashpot law of He et al. (Eqs. 1-3), with r* = Ra Rb/(Ra + Rb).

The springs are bounded, |ft| <= mu fn and |M| <= mu_r r* fn with fn = kn delta, and the dashpots act in parallel as
long as the grains overlap. A head-on pair therefore separates at exp(-pi beta/sqrt(1 - beta^2)) times its
approach speed, and the normal force may become slightly tensile just before separation.

The history is rotated with the contact exactly: by the smallest rotation from the previous normal to the current one,
then about the normal with the mean spin of the two grains. Increments are evaluated at the midpoint normal (second
order in dt).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.dem.laws.base import Contact, ContactLaw, Features, Response
from labkit.dem.laws.vectors import ZERO, Vector, along_branch, cap, cross, dot, minus, plus, times

if TYPE_CHECKING:
    from labkit.dem.scene import Scene

STIFFEST_DAMPING = 3.4  # damping ratio of the stiffest mode divided by that of one contact; a grain has many dashpots


class SpringDashpot(ContactLaw):
    """Spring-dashpot law of He et al. (Eqs. 1-3): bounded springs and dashpots, no local damping."""

    name = "spring_dashpot"
    description = "spring-dashpot law of He et al. (Eqs. 1-3)"

    def rolling_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Rolling stiffness kr = kt r*^2 (Eq. 3), N m."""
        reduced = radius_a * radius_b / (radius_a + radius_b)
        return self.tangential_stiffness(scene, radius_a, radius_b) * reduced**2

    def dashpots(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal and tangential 2 beta sqrt(m* k), m* = ma mb/(ma + mb) (Eqs. 1, 2), N s/m."""
        a, b = scene.mass(radius_a), scene.mass(radius_b)
        reduced = a * b / (a + b)
        kn = self.normal_stiffness(scene, radius_a, radius_b)
        kt = self.tangential_stiffness(scene, radius_a, radius_b)
        return 2.0 * scene.beta_n * np.sqrt(reduced * kn), 2.0 * scene.beta_t * np.sqrt(reduced * kt)

    def damping_ratio(self, scene: Scene) -> float:
        return STIFFEST_DAMPING * max(scene.beta_n, scene.beta_t)

    def features(self, scene: Scene) -> Features:
        """Friction, rolling resistance and dashpots of the scene.

        rolling: mu_r; dashpots: (2 beta_n, 2 beta_t, density 4/3 pi).
        """
        friction = scene.friction if scene.friction > 0.0 else None
        rolling = scene.rolling_friction if scene.rolling_friction > 0.0 else None
        dashpots = None
        if scene.beta_n > 0.0 or scene.beta_t > 0.0:
            dashpots = (2.0 * scene.beta_n, 2.0 * scene.beta_t, scene.mass(1.0))
        return Features((1.0 / scene.stiffness_ratio,), friction, rolling, dashpots, None, True)

    @staticmethod
    def pair(
        contact: Contact,
        tangential_force: Vector,
        rolling_moment: Vector,
        dt: float,
        constants: tuple[float, ...],
        friction: Any,
        rolling: Any,
        dashpots: Any,
        energy: Any,
    ) -> Response:
        """The Response of a contact; rolling: mu_r; dashpots: (2 beta_n, 2 beta_t, density 4/3 pi)."""
        n, v, ra, rb = contact.normal, contact.velocity, contact.radius_a, contact.radius_b
        a, b, overlap = contact.spin_a, contact.spin_b, contact.overlap
        touching = 1.0 if overlap >= 0.0 else 0.0
        spring = touching * contact.stiffness * overlap
        old = along_branch(contact.branch, v, dt, contact.inverse)
        halfway = along_branch(contact.branch, v, 0.5 * dt, contact.inverse)
        half_angle = 0.25 * dt * dot(n, plus(a, b))
        # relative velocity of the two grains at the contact point, at mid-step
        half_overlap = 0.5 * (overlap + 0.5 * dt * dot(n, v))
        surface = cross(plus(times(ra - half_overlap, a), times(rb - half_overlap, b)), halfway)
        slip = minus(minus(v, times(dot(halfway, v), halfway)), surface)
        slip = minus(slip, times(dot(n, slip), n))
        approach = -dot(n, v)
        kt = constants[0] * contact.stiffness
        fn, ft = spring, ZERO
        friction_loss = rolling_loss = dashpot_loss = 0.0
        if dashpots is not None:  # viscous part of Eqs. 1 and 2, m* = ma mb/(ma + mb)
            ca, cb = dashpots[2] * ra * ra * ra, dashpots[2] * rb * rb * rb
            root = touching * math.sqrt(ca * cb / (ca + cb) * contact.stiffness)
            cn, ct = dashpots[0] * root, dashpots[1] * math.sqrt(constants[0]) * root
            fn += cn * approach
            ft = times(ct, slip)
            if energy is not None:
                dashpot_loss = dt * (cn * approach * approach + ct * dot(slip, slip))
        if friction is not None:  # Eq. 2
            t = turned(tangential_force, old, n, half_angle)
            t = plus(t, times(kt * dt, slip))
            squared = dot(t, t)
            scale = cap(squared, friction * spring)
            tangential_force = times(scale, t)
            ft = plus(ft, tangential_force)
            if energy is not None:
                friction_loss = (1.0 - scale) * scale * squared / kt
        force = minus(ft, times(fn, n))
        turn = cross(n, ft)
        torque_a, torque_b = times(ra - 0.5 * overlap, turn), times(rb - 0.5 * overlap, turn)
        if rolling is not None:  # Eq. 3
            m = turned(rolling_moment, old, n, half_angle)
            bend = minus(b, a)
            reduced = ra * rb / (ra + rb)  # r*
            kr = kt * reduced * reduced
            m = plus(m, times(kr * dt, minus(bend, times(dot(bend, n), n))))
            squared = dot(m, m)
            scale = cap(squared, rolling * reduced * spring)
            rolling_moment = times(scale, m)
            torque_a, torque_b = plus(torque_a, rolling_moment), minus(torque_b, rolling_moment)
            if energy is not None:
                rolling_loss = (1.0 - scale) * scale * squared / kr
        return Response(
            force, torque_a, torque_b, tangential_force, rolling_moment, friction_loss, rolling_loss, dashpot_loss
        )


def turned(t: Vector, old: Vector, n: Vector, half_angle: float) -> Vector:
    """A vector normal to `old`, rotated into the plane normal to n and then about n; its length is preserved."""
    share = dot(t, n) / (1.0 + dot(old, n))
    t = minus(t, times(share, plus(old, n)))
    square = half_angle * half_angle
    cosine, sine = (1.0 - square) / (1.0 + square), 2.0 * half_angle / (1.0 + square)
    return plus(times(cosine, t), times(sine, cross(n, t)))
