"""The contact laws of labkit; each law is a sum of parts."""

from __future__ import annotations

from labkit.grains.laws.bond import ParallelBond
from labkit.grains.laws.cohesion import Adhesion, Bridge, Neck
from labkit.grains.laws.damping import Dashpots, DashpotsOfYade, LocalDamping
from labkit.grains.laws.kinematics import Midpoint, WithoutRatcheting
from labkit.grains.laws.law import ContactLaw
from labkit.grains.laws.normal import HertzSpring, LinearSpring, SpringsInSeries
from labkit.grains.laws.rolling import Rolling, RollingOfYade, Twisting, TwistingOfYade
from labkit.grains.laws.tangential import Coulomb, CoulombOfYade, Mindlin, RescaledMindlin


class RollingResistance(ContactLaw):
    """Law2_ScGeom6D_CohFrictPhys_CohesionMoment of YADE with Ig2_Sphere_Sphere_ScGeom6D; see labkit.grains.scene.Scene.

    Differences from Eqs. 1-3: no dashpots; the relative velocity of the centres is multiplied by (Ra + Rb)/|d| to avoid
    ratcheting; the contact history rotates with the contact to first order only; kr = kt Ra Rb/4, |M| <= eta min(Ra,
    Rb) fn.
    """

    name = "rolling_resistance"
    description = "rolling-resistance law of YADE"
    parts = LinearSpring() + CoulombOfYade() + RollingOfYade() + TwistingOfYade() + LocalDamping()
    kinematics = WithoutRatcheting
    avoids_ratcheting = True


class SpringDashpot(ContactLaw):
    """Spring-dashpot law of He et al. (Eqs. 1-3): bounded springs and dashpots, no local damping."""

    name = "spring_dashpot"
    description = "spring-dashpot law of He et al. (Eqs. 1-3)"
    parts = LinearSpring() + Coulomb() + Rolling() + Twisting() + Dashpots()
    kinematics = Midpoint


class SpringsInSeriesDashpot(ContactLaw):
    """Spring-dashpot law with the stiffness of PFC, pi E min(R)^2/(Ra + Rb)."""

    name = "springs_in_series"
    description = "spring-dashpot law with the stiffness of PFC"
    parts = SpringsInSeries() + Coulomb() + Rolling() + Twisting() + Dashpots()
    kinematics = Midpoint


class HertzMindlin(ContactLaw):
    """Law2_ScGeom_MindlinPhys_Mindlin of YADE with Ip2_FrictMat_FrictMat_MindlinPhys, without rolling resistance.

    kt/kn = 2 (1 - nu)/(2 - nu): `stiffness_ratio` and the rolling parameters are refused. f~, Lambda = f~/E and C0 are
    computed from forces alone; E is the Young's modulus of the grains. A stress p causes overlaps of the order of
    delta/D = (p/E)^(2/3).

    In YADE the friction loss is the functor's `frictionDissipation`, the work at sliding contacts only. It contains
    neither the energy dissipated by a change of kt (labkit.grains.laws.tangential.Mindlin) nor the elastic energy that
    a sliding contact releases as its normal force falls. The relative velocity is taken at the contact point
    (avoidGranularRatcheting is off), because the factor that avoids ratcheting would make the work of ft inconsistent
    by delta/(Ra + Rb).
    """

    name = "hertz_mindlin"
    description = "Hertz-Mindlin law of YADE"
    parts = HertzSpring() + Mindlin() + LocalDamping()


class HertzMindlinRolling(ContactLaw):
    """Hertz-Mindlin law with local damping and rolling resistance: kr = kt r*^2 at the overlap, |M| <= mu_r r* fn.

    This is the rolling model epsd2 of LIGGGHTS combined with Hertz-Mindlin contacts. YADE's Mindlin functor instead has
    the same kr for all contacts.
    """

    name = "hertz_mindlin_rolling"
    description = "Hertz-Mindlin law with rolling resistance"
    parts = HertzSpring() + Mindlin() + Rolling() + Twisting() + LocalDamping()


class HertzMindlinDashpot(ContactLaw):
    """YADE's Hertz-Mindlin law with dashpots and without local damping."""

    name = "hertz_mindlin_dashpot"
    description = "Hertz-Mindlin law of YADE with dashpots"
    parts = HertzSpring() + Mindlin() + DashpotsOfYade()


class HertzMindlinRescaled(ContactLaw):
    """Hertz-Mindlin law with local damping whose tangential force is rescaled when the normal force falls."""

    name = "hertz_mindlin_rescaled"
    description = "Hertz-Mindlin law that creates no energy (Thornton)"
    parts = HertzSpring() + RescaledMindlin() + LocalDamping()


class Dmt(ContactLaw):
    """Hertz-Mindlin law with DMT adhesion and local damping."""

    name = "dmt"
    description = "Hertz-Mindlin law with DMT adhesion"
    parts = HertzSpring() + Mindlin() + LocalDamping() + Adhesion()


class Jkr(ContactLaw):
    """Hertz-Mindlin law with local damping and JKR adhesion, which can span a gap."""

    name = "jkr"
    description = "Hertz-Mindlin law with JKR adhesion"
    parts = HertzSpring() + Mindlin() + LocalDamping() + Neck()


class Bonded(ContactLaw):
    """Rolling-resistance law with parallel bonds, which labkit.bond creates, and second-order kinematics."""

    name = "bonded"
    description = "rolling-resistance law with parallel bonds"
    parts = LinearSpring() + Coulomb() + Rolling() + Twisting() + LocalDamping() + ParallelBond()
    kinematics = Midpoint


class Capillary(ContactLaw):
    """Rolling-resistance law with capillary bridges."""

    name = "capillary"
    description = "rolling-resistance law with capillary bridges"
    parts = LinearSpring() + Coulomb() + Rolling() + Twisting() + LocalDamping() + Bridge()
    kinematics = Midpoint
