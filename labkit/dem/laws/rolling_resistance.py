"""The rolling-resistance law of YADE: Law2_ScGeom6D_CohFrictPhys_CohesionMoment with Ig2_Sphere_Sphere_ScGeom6D.

Differences from Eqs. 1-3: no dashpots; the relative velocity of the centres is multiplied by (Ra + Rb)/|d| to avoid
ratcheting; the history is rotated with the contact to first order only; kr = kt Ra Rb/4, |M| <= eta min(Ra, Rb) fn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from labkit.dem.laws.base import Contact, ContactLaw, Features, Response, YadeLaw
from labkit.dem.laws.vectors import ZERO, Vector, along_branch, cap, cross, dot, minus, plus, times

if TYPE_CHECKING:
    from labkit.dem.scene import Scene


class RollingResistance(ContactLaw):
    """Rolling-resistance law of YADE, with local non-viscous damping; see labkit.dem.scene.Scene."""

    name = "rolling_resistance"
    description = "rolling-resistance law of YADE"
    avoids_ratcheting = True

    def rolling_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Rolling stiffness kr = kt Ra Rb/4, N m."""
        return self.tangential_stiffness(scene, radius_a, radius_b) * (radius_a * radius_b / 4.0)

    def features(self, scene: Scene) -> Features:
        """Friction, rolling resistance and damping of the scene; rolling: YADE's (alphaKr, etaRoll)."""
        rolling = None
        if scene.rolling_friction > 0.0:
            rolling = (0.25, 0.5 * scene.rolling_limit_scale * scene.rolling_friction)
        friction = scene.friction if scene.friction > 0.0 else None
        damping = scene.local_damping if scene.local_damping > 0.0 else None
        turning = True if friction is not None or rolling is not None else None
        return Features((1.0 / scene.stiffness_ratio,), friction, rolling, None, damping, turning)

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
        """The Response of a contact; rolling: (alphaKr, etaRoll)."""
        n, ra, rb = contact.normal, contact.radius_a, contact.radius_b
        fn = contact.stiffness * contact.overlap if contact.overlap >= 0.0 else 0.0
        force, torque_a, torque_b = times(-fn, n), ZERO, ZERO
        friction_loss = rolling_loss = 0.0
        if friction is not None or rolling is not None:
            old = along_branch(contact.branch, contact.velocity, dt, contact.inverse)
            swing = cross(old, n)
            twist = 0.5 * dt * dot(old, plus(contact.spin_a, contact.spin_b))
            roll = times(twist, old)
            kt = constants[0] * contact.stiffness
            if energy is not None:
                per_stiffness = 1.0 / (kt * ra * rb)
        if friction is not None:
            t = tangential_force
            t = minus(t, cross(t, swing))
            t = minus(t, cross(t, roll))
            ratio = (ra + rb) * contact.inverse  # avoids ratcheting
            surface = cross(plus(times(ra, contact.spin_a), times(rb, contact.spin_b)), n)
            slip = minus(times(ratio, contact.velocity), surface)
            t = plus(t, times(kt * dt, minus(slip, times(dot(slip, n), n))))
            squared = dot(t, t)
            scale = cap(squared, friction * fn)
            tangential_force = times(scale, t)
            force = plus(force, tangential_force)
            turn = cross(n, tangential_force)
            torque_a = times(ra - 0.5 * contact.overlap, turn)
            torque_b = times(rb - 0.5 * contact.overlap, turn)
            if energy is not None:
                friction_loss = (1.0 - scale) * scale * squared * (ra * rb * per_stiffness)
        if rolling is not None:
            m = rolling_moment
            m = minus(m, cross(m, swing))
            m = minus(m, cross(m, roll))
            bend = minus(contact.spin_b, contact.spin_a)
            kr = rolling[0] * ra * rb * kt
            m = plus(m, times(kr * dt, minus(bend, times(dot(bend, n), n))))
            squared = dot(m, m)
            scale = cap(squared, rolling[1] * min(ra, rb) * fn)
            rolling_moment = times(scale, m)
            torque_a = plus(torque_a, rolling_moment)
            torque_b = minus(torque_b, rolling_moment)
            if energy is not None:
                rolling_loss = (1.0 - scale) * scale * squared * (per_stiffness / rolling[0])
        return Response(force, torque_a, torque_b, tangential_force, rolling_moment, friction_loss, rolling_loss, 0.0)

    def yade(self, scene: Scene) -> YadeLaw:
        """Law2_ScGeom6D_CohFrictPhys_CohesionMoment without cohesion; its incremental form needs no grain rotations."""
        from yade import wrapper as w

        return YadeLaw(
            lambda radius: material(scene, radius),
            [w.Ig2_Sphere_Sphere_ScGeom6D(updateRotations=False)],
            [w.Ip2_CohFrictMat_CohFrictMat_CohFrictPhys()],
            [w.Law2_ScGeom6D_CohFrictPhys_CohesionMoment(useIncrementalForm=True, always_use_moment_law=True)],
            "shearForce",
            "moment_bending",
            ("shearDissip", "bendingDissip"),
        )


def material(scene: Scene, radius: float) -> Any:
    """YADE's material for a grain of the scene, without cohesion and twisting moments.

    YADE's kn is 2 Ea Ra Eb Rb/(Ea Ra + Eb Rb): setting `young` = kn/R for two equal grains reproduces the kn of the
    scene. For spheres this is (pi/2) E for any radius. Negative cohesion or moment limits, YADE's defaults, would mean
    no limit.
    """
    from yade.wrapper import CohFrictMat

    return CohFrictMat(
        young=float(scene.normal_stiffness(radius, radius)) / radius,
        poisson=1.0 / scene.stiffness_ratio,  # gives kt = kn/kappa exactly
        density=scene.density,
        frictionAngle=float(np.arctan(scene.friction)),
        isCohesive=False,
        normalCohesion=0.0,
        shearCohesion=0.0,
        fragile=True,
        momentRotationLaw=scene.rolling_friction > 0.0,
        alphaKr=0.25,
        etaRoll=0.5 * scene.rolling_limit_scale * scene.rolling_friction,
        alphaKtw=0.0,
        etaTwist=0.0,
    )
