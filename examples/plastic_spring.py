"""A part with a history: a normal spring with plastic unloading (Walton and Braun 1986).

labkit specimen --void-ratio 0.65 --preparation compression --pressure 100kPa --law plastic \
    --use examples/plastic_spring.py -o s.state.nc
"""

import numpy as np

import labkit as lk

RATIO = 1.5  # stiffness of unloading over that of loading


class PlasticSpring(lk.laws.LinearSpring):
    """fn = kn delta in loading; RATIO kn (delta - (1 - 1/RATIO) deepest overlap), never tensile, in unloading."""

    history = {"deepest_overlap": lk.laws.Column("m", "deepest overlap since the grains touched")}
    losses = {"plastic_loss": "energy dissipated by plastic contacts"}

    def begin(self, overlap):
        return {"deepest_overlap": np.maximum(overlap, 0.0)}

    @staticmethod
    def respond(contact, history, numbers):
        depth, before = max(contact.overlap, 0.0), history.deepest_overlap
        deepest = max(before, depth) if contact.overlap >= 0.0 else 0.0
        loss = 0.5 * (1.0 - 1.0 / RATIO) * contact.stiffness * max(depth * depth - before * before, 0.0)
        return unload(contact.stiffness, depth, deepest), (deepest,), (loss,)

    @staticmethod
    def normal_force(contact, history, numbers):
        return unload(contact.stiffness, contact.overlap, history.deepest_overlap)

    @staticmethod
    def stored_energy(contact, history, numbers):
        force = unload(contact.stiffness, contact.overlap, history.deepest_overlap)
        return 0.5 * force * force / (RATIO * contact.stiffness)

    @staticmethod
    def tangent(stiffness, overlap, mass=1.0):
        return RATIO * mass * stiffness


def unload(stiffness, depth, deepest):
    """Force at the overlap `depth`, m, after the overlap `deepest`, m; N."""
    return np.maximum(RATIO * stiffness * (depth - (1.0 - 1.0 / RATIO) * deepest), 0.0)


@lk.register_law
class Plastic(lk.ContactLaw):
    """Plastic normal springs, with friction and rolling resistance of Eqs. 2 and 3 and local damping."""

    name = "plastic"
    kinematics = lk.laws.Midpoint
    parts = PlasticSpring() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.LocalDamping()
