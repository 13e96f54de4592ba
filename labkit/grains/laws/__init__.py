"""Contact laws, each a sum of parts.

vectors      three-component vectors with operators
contact      a contact, its motion in a time step and its response
parts        the interface of a part, and sums of parts
kinematics   how a contact and its history move in a time step
normal, tangential, rolling, damping, cohesion, bond: the parts
pair         the force of a contact in a time step, composed of parts
law          interface of a contact law
yade         a contact law in YADE, as data
named        the laws of labkit, and their functors in YADE
"""

from typing import TypeVar

import numpy as np

from labkit.errors import InputError
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

Kind = TypeVar("Kind", bound=ContactLaw)

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


def register_law(kind: type[Kind]) -> type[Kind]:
    """Register a subclass of ContactLaw under its `name` and return it; a decorator.

    Raises InputError if the force of its normal part is not the derivative of its energy.
    """
    require_potential(kind)
    return LAWS.register(kind)


def require_potential(kind: type[ContactLaw]) -> None:
    """Raise InputError if the force of the normal part of a law is not the derivative of its energy."""
    normal, radius = kind.normal, 1e-4
    stiffness = normal.stiffness(1e9, radius, radius)
    for overlap in radius * np.geomspace(1e-4, 0.2, 20):
        step = 1e-4 * overlap
        force = normal.force(stiffness, overlap)
        slope = (normal.energy(stiffness, overlap + step) - normal.energy(stiffness, overlap - step)) / (2.0 * step)
        if not abs(slope - force) <= 1e-6 * max(abs(force), stiffness * overlap):
            raise InputError(
                f"contact law {getattr(kind, 'name', kind.__name__)}: the force of {type(normal).__name__} is not the "
                f"derivative of its energy ({force:.6g} N against {slope:.6g} N at an overlap of {overlap:.3g} m)"
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
    "register_law",
]
