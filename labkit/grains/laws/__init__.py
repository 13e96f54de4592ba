"""Contact laws; each law is a sum of parts.

vectors      three-component vectors with operators
contact      a contact, its motion in a time step and its response
parts        the interface of a part, and sums of parts
kinematics   how a contact and its history move in a time step
normal, tangential, rolling, damping, cohesion, bond: the parts
pair         the force of a contact in a time step, composed of parts
law          the interface of a contact law
yade         the description of a contact law for YADE
named        the contact laws of labkit
"""

from labkit.extensions import Registry
from labkit.grains.laws.bond import ParallelBond
from labkit.grains.laws.cohesion import Adhesion, Bridge, Neck
from labkit.grains.laws.contact import Contact, ContactMotion, ContactStep, Response, Share, Tangents
from labkit.grains.laws.damping import Dashpots, DashpotsOfYade, LocalDamping
from labkit.grains.laws.kinematics import FirstOrder, Midpoint, WithoutRatcheting
from labkit.grains.laws.law import ContactLaw
from labkit.grains.laws.normal import HertzSpring, LinearSpring, SpringsInSeries
from labkit.grains.laws.parts import Column, LawPart, LawParts
from labkit.grains.laws.rolling import Rolling, RollingOfYade, Twisting, TwistingOfYade
from labkit.grains.laws.tangential import Coulomb, CoulombOfYade, Mindlin, RescaledMindlin
from labkit.grains.laws.vectors import ZERO, Vector, across, cross, dot

LAWS = Registry[type[ContactLaw]](
    "contact law",
    {
        "rolling_resistance": "labkit.grains.laws.named:RollingResistance",
        "spring_dashpot": "labkit.grains.laws.named:SpringDashpot",
        "springs_in_series": "labkit.grains.laws.named:SpringsInSeriesDashpot",
        "hertz_mindlin": "labkit.grains.laws.named:HertzMindlin",
        "hertz_mindlin_rolling": "labkit.grains.laws.named:HertzMindlinRolling",
        "hertz_mindlin_dashpot": "labkit.grains.laws.named:HertzMindlinDashpot",
        "hertz_mindlin_rescaled": "labkit.grains.laws.named:HertzMindlinRescaled",
        "dmt": "labkit.grains.laws.named:Dmt",
        "jkr": "labkit.grains.laws.named:Jkr",
        "bonded": "labkit.grains.laws.named:Bonded",
        "capillary": "labkit.grains.laws.named:Capillary",
    },
)


__all__ = [
    "LAWS",
    "ZERO",
    "Adhesion",
    "Bridge",
    "Column",
    "Contact",
    "ContactLaw",
    "ContactMotion",
    "ContactStep",
    "Coulomb",
    "CoulombOfYade",
    "Dashpots",
    "DashpotsOfYade",
    "FirstOrder",
    "HertzSpring",
    "LawPart",
    "LawParts",
    "LinearSpring",
    "LocalDamping",
    "Midpoint",
    "Mindlin",
    "Neck",
    "ParallelBond",
    "RescaledMindlin",
    "Response",
    "Rolling",
    "RollingOfYade",
    "Share",
    "SpringsInSeries",
    "Tangents",
    "Twisting",
    "TwistingOfYade",
    "Vector",
    "WithoutRatcheting",
    "across",
    "cross",
    "dot",
]
