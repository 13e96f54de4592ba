"""A user-defined part with a history: a normal spring with plastic unloading (Walton and Braun 1986).

labkit specimen --void-ratio 0.65 --grains 500 --law plastic --use examples/plastic_spring.py -o s.state.nc
"""

import labkit as lk

RATIO = 1.5  # stiffness of unloading over that of loading; the restitution is sqrt(1/RATIO)


class PlasticSpring(lk.laws.LinearSpring):
    """fn = kn delta in loading, RATIO kn (delta - delta0) in unloading and reloading, never tensile.

    delta0 = (1 - 1/RATIO) times the deepest overlap since the grains touched.
    """

    history = {"deepest_overlap": lk.laws.Column("m", "deepest overlap since the grains touched")}
    losses = {"plastic_loss": "energy dissipated by plastic contacts"}

    @staticmethod
    def respond(contact, history, numbers):
        """Force, N, new history and loss, J, of a contact in a time step."""
        depth = max(contact.overlap, 0.0)
        deepest = max(history.deepest_overlap, depth) if contact.overlap >= 0.0 else 0.0
        deeper = max(depth * depth - history.deepest_overlap * history.deepest_overlap, 0.0)
        loss = 0.5 * (1.0 - 1.0 / RATIO) * contact.stiffness * deeper
        return unload(contact.stiffness, depth, deepest), (deepest,), (loss,)

    @staticmethod
    def normal_force(contact, history, numbers):
        """Force from the history, N."""
        return unload(contact.stiffness, contact.overlap, history.deepest_overlap)

    @staticmethod
    def stored_energy(contact, history, numbers):
        """Elastic energy from the history, J."""
        force = unload(contact.stiffness, contact.overlap, history.deepest_overlap)
        return 0.5 * force * force / (RATIO * contact.stiffness)

    @staticmethod
    def tangent(stiffness, overlap, mass=1.0):
        """Largest stiffness, N/m, times a mass, kg; it sets the time step."""
        return RATIO * mass * stiffness


def unload(stiffness, depth, deepest):
    """Force of the spring at an overlap, N, after the deepest one."""
    return lk.laws.maximum(RATIO * stiffness * (depth - (1.0 - 1.0 / RATIO) * deepest), 0.0)


@lk.register_law
class Plastic(lk.ContactLaw):
    """The law of the paper, without dashpots, on plastic contacts."""

    name = "plastic"
    kinematics = lk.laws.Midpoint
    parts = PlasticSpring() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.LocalDamping()
