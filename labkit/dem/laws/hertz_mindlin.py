"""The Hertz-Mindlin law of YADE: Law2_ScGeom_MindlinPhys_Mindlin with Ip2_FrictMat_FrictMat_MindlinPhys.

For grains of Young's modulus E and Poisson's ratio nu, with R* = Ra Rb/(Ra + Rb) and the overlap delta:

    fn = kno delta^(3/2)                  kno = 4/3 E* sqrt(R*),              E* = E/(2 (1 - nu^2))      (Hertz)
    d ft = kt d u,  |ft| <= mu fn         kt = kso sqrt(delta),               kso = 4 G sqrt(R*)/(2 - nu) (Mindlin)
    kn = d fn/d delta = 3/2 kno sqrt(delta)                                   G = E/(2 (1 + nu))

so that kt/kn = 2 (1 - nu)/(2 - nu): `stiffness_ratio` and the rolling parameters have no effect. This is Mindlin's
stiffness without microslip. There is no rolling resistance. Local non-viscous damping as in `rolling_resistance`.

f~ and Lambda = f~/E, and with them C0, need only forces; E in them is that of the grains. A stress p gives an overlap
of the order delta/D = (p/E)^(2/3).

Energy. The normal spring stores 2/5 kno delta^(5/2). A tangential spring whose stiffness depends on delta has no
potential: the work of ft depends on the order of normal and tangential loading. We take W = ft^2/(2 kt) for the stored
energy, which is exact at constant delta. When delta changes at constant ft, W changes by -W d(delta)/(2 delta) although
no work is done in the tangential direction. That energy, lost in loading and created in unloading, is summed from its
formula and counted with the friction loss; the balance is then closed. In closed cycles it is a property of the law,
not of the integration (Elata and Berryman 1996).

In YADE the sum of friction is `frictionDissipation` of the functor, work at sliding contacts only. It contains neither
this energy nor the elastic energy that a sliding contact releases as its normal force falls. The relative velocity is
that of the contact points (avoidGranularRatcheting is off), because the factor that avoids ratcheting would make the
work of ft inconsistent by delta/(Ra + Rb).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from labkit.dem.laws.base import Contact, ContactLaw, Features, Response, Tangents, YadeLaw
from labkit.dem.laws.vectors import ZERO, Vector, along_branch, cap, cross, dot, minus, plus, times

if TYPE_CHECKING:
    from labkit.dem.scene import Scene
    from labkit.micro.snapshot import Snapshot

LOADING_STEP = 1e-30  # s; this functor of YADE divides by the time step


class HertzMindlin(ContactLaw):
    """Hertz-Mindlin law of YADE without rolling resistance, with local non-viscous damping."""

    name = "hertz_mindlin"
    description = "Hertz-Mindlin law of YADE"

    def normal_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Coefficient kno = 4/3 E* sqrt(R*) of fn = kno delta^(3/2), N/m^(3/2)."""
        if scene.planar:
            return self.stiffness_factor(scene) * np.sqrt(np.full_like(radius_a + radius_b, scene.mean_diameter / 4.0))
        return super().normal_stiffness(scene, radius_a, radius_b)

    def stiffness_factor(self, scene: Scene) -> float:
        return 2.0 / 3.0 * scene.young_modulus / (1.0 - scene.poisson_ratio**2)

    @staticmethod
    def pair_stiffness(factor: float, radius_a: float, radius_b: float) -> float:
        """The coefficient kno; factor: 4/3 E*."""
        return factor * np.sqrt(radius_a * radius_b / (radius_a + radius_b))

    def tangential_stiffness(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray) -> np.ndarray:
        """Coefficient kso of kt = kso sqrt(delta), N/m^(3/2)."""
        return tangential_share(scene) * self.normal_stiffness(scene, radius_a, radius_b)

    def tangents(self, scene: Scene, radius_a: np.ndarray, radius_b: np.ndarray, overlap: np.ndarray) -> Tangents:
        root = np.sqrt(np.maximum(overlap, 0.0))
        kn = 1.5 * self.normal_stiffness(scene, radius_a, radius_b) * root
        kt = self.tangential_stiffness(scene, radius_a, radius_b) * root
        nothing = np.zeros_like(kn)
        return Tangents(kn, kt, nothing, nothing)

    @staticmethod
    def spring(stiffness: float, overlap: float) -> float:
        """Hertz's normal force kno delta^(3/2), N."""
        overlap = np.maximum(overlap, 0.0)
        return stiffness * overlap * np.sqrt(overlap)

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Sum of 2/5 fn delta + ft^2/(2 kt), J."""
        contacts, scene = snapshot.contacts, cast("Scene", snapshot.scene)
        a, b = snapshot.radius[contacts.grain[:, 0]], snapshot.radius[contacts.grain[:, 1]]
        kt = self.tangents(scene, a, b, contacts.overlap).tangential
        squared = np.einsum("ci,ci->c", contacts.tangential_force, contacts.tangential_force)
        tangential = np.divide(squared, 2.0 * kt, out=np.zeros_like(kt), where=kt > 0.0)
        return float(np.sum(0.4 * contacts.normal_force * contacts.overlap + tangential))

    def features(self, scene: Scene) -> Features:
        """Friction and local damping of the scene; constants: (kso/kno,)."""
        return super().features(scene)._replace(constants=(tangential_share(scene),))

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
        """The Response of a contact; dashpots: (2 beta_n, 2 beta_t, density 4/3 pi)."""
        n, v, ra, rb = contact.normal, contact.velocity, contact.radius_a, contact.radius_b
        overlap = max(contact.overlap, 0.0)
        root = math.sqrt(overlap)
        spring = contact.stiffness * overlap * root
        fn, friction_loss, dashpot_loss = spring, 0.0, 0.0
        kt = constants[0] * contact.stiffness * root
        if dashpots is not None:
            ca, cb = dashpots[2] * ra * ra * ra, dashpots[2] * rb * rb * rb
            mass = ca * cb / (ca + cb)
            approach = -dot(n, v)
            viscous = dashpots[0] * math.sqrt(1.5 * mass * contact.stiffness * root) * approach
            fn = max(spring + viscous, 0.0)
            if energy is not None:
                dashpot_loss = dt * (fn - spring) * approach
        force, torque_a, torque_b = times(-fn, n), ZERO, ZERO
        if friction is not None:
            arm_a, arm_b = ra - 0.5 * contact.overlap, rb - 0.5 * contact.overlap
            old = along_branch(contact.branch, v, dt, contact.inverse)
            twist = 0.5 * dt * dot(old, plus(contact.spin_a, contact.spin_b))
            t = tangential_force
            t = minus(t, cross(t, cross(old, n)))
            t = minus(t, cross(t, times(twist, old)))
            slip = minus(v, cross(plus(times(arm_a, contact.spin_a), times(arm_b, contact.spin_b)), n))
            slip = minus(slip, times(dot(slip, n), n))
            if energy is not None:
                friction_loss = stiffness_loss(contact, dot(t, t), kt, constants[0], dt)
            t = plus(t, times(kt * dt, slip))
            squared = dot(t, t)
            scale = cap(squared, friction * fn)
            tangential_force = times(scale, t)
            ft = tangential_force
            if dashpots is not None:
                sticking = dashpots[1] * math.sqrt(mass * kt) if scale == 1.0 else 0.0
                ft = plus(ft, times(sticking, slip))
                if energy is not None:
                    dashpot_loss += dt * sticking * dot(slip, slip)
            force = plus(force, ft)
            turn = cross(n, ft)
            torque_a, torque_b = times(arm_a, turn), times(arm_b, turn)
            if energy is not None:
                friction_loss += (1.0 - scale) * scale * squared / kt if kt > 0.0 else 0.0
        return Response(force, torque_a, torque_b, tangential_force, rolling_moment, friction_loss, 0.0, dashpot_loss)

    def yade(self, scene: Scene) -> YadeLaw:
        """Law2_ScGeom_MindlinPhys_Mindlin without adhesion and moments."""
        from yade import wrapper as w

        dashpots = self.features(scene).dashpots
        beta = {} if dashpots is None else {"betan": scene.beta_n, "betas": scene.beta_t}
        law = w.Law2_ScGeom_MindlinPhys_Mindlin(calcEnergy=True)
        return YadeLaw(
            lambda radius: w.FrictMat(
                young=scene.young_modulus,
                poisson=scene.poisson_ratio,
                density=scene.density,
                frictionAngle=float(np.arctan(scene.friction)),
            ),
            [w.Ig2_Sphere_Sphere_ScGeom(avoidGranularRatcheting=False)],
            [w.Ip2_FrictMat_FrictMat_MindlinPhys(**{name: _constant(value) for name, value in beta.items()})],
            [law],
            "shearElastic",
            "momentBend",
            loading_step=LOADING_STEP,
            dissipated=lambda: (law.frictionDissipation, 0.0, law.normDampDissip + law.shearDampDissip),
        )


def _constant(value: float) -> Any:
    """YADE's MatchMaker that gives every pair of materials the same value."""
    from yade.wrapper import MatchMaker

    return MatchMaker(algo="val", val=value)


def tangential_share(scene: Scene) -> float:
    """kso/kno = 3 (1 - nu)/(2 - nu)."""
    return 3.0 * (1.0 - scene.poisson_ratio) / (2.0 - scene.poisson_ratio)


def stiffness_loss(contact: Contact, squared: float, kt: float, share: float, dt: float) -> float:
    """Energy ft^2/2 (1/kt' - 1/kt) that the tangential spring loses as kt' of the previous step becomes kt, J.

    squared: ft^2 at the start of the step; share: kso/kno. A contact that has opened loses what it stored.
    """
    branch = minus(contact.branch, times(dt, contact.velocity))
    before = contact.radius_a + contact.radius_b - math.sqrt(dot(branch, branch))
    kt_before = share * contact.stiffness * math.sqrt(max(before, 0.0))
    lost = 0.5 * squared / kt_before if kt_before > 0.0 else 0.0
    return lost - (0.5 * squared / kt if kt > 0.0 else 0.0) if lost > 0.0 else 0.0
