"""A part with a history: a normal spring with plastic unloading (Walton and Braun 1986).

labkit specimen --void-ratio 0.65 --preparation compression --pressure 100kPa --law plastic \
    --unloading-ratio 1.5 --use examples/plastic_spring.py -o s.state.nc
"""

import numpy as np

import labkit as lk


class PlasticSpring(lk.laws.LinearSpring):
    """fn = k1 delta in loading; k2 (delta - (1 - k1/k2) deepest overlap), never tensile, in unloading.

    k1 is kn of Eq. 1, and k2/k1 = `unloading_ratio`; the coefficient of a contact is k2.
    """

    parameters = {
        "unloading_ratio": lk.parameter(1.5, low=1.0, high=100.0, help="stiffness of unloading over that of loading")
    }
    history = {"deepest_overlap": lk.laws.Column("m", "deepest overlap since the grains touched")}
    losses = {"plastic_loss": "energy dissipated by plastic contacts"}

    def numbers(self, scene):
        return (1.0 / scene.unloading_ratio,)

    def factor(self, scene):
        return super().factor(scene) * scene.unloading_ratio

    def begin(self, overlap):
        return {"deepest_overlap": np.maximum(overlap, 0.0)}

    @staticmethod
    def respond(contact, history, numbers):
        depth, before, ratio = max(contact.overlap, 0.0), history.deepest_overlap, numbers[0]
        deepest = max(before, depth) if contact.overlap >= 0.0 else 0.0
        loss = 0.5 * ratio * (1.0 - ratio) * contact.stiffness * max(depth * depth - before * before, 0.0)
        return unload(contact.stiffness, ratio, depth, deepest), (deepest,), (loss,)

    @staticmethod
    def normal_force(contact, history, numbers):
        return unload(contact.stiffness, numbers[0], contact.overlap, history.deepest_overlap)

    @staticmethod
    def stored_energy(contact, history, numbers):
        force = unload(contact.stiffness, numbers[0], contact.overlap, history.deepest_overlap)
        return 0.5 * force * force / contact.stiffness


def unload(stiffness, ratio, depth, deepest):
    """Force at the overlap `depth`, m, after the overlap `deepest`, m, with k2, N/m, and k1/k2; N."""
    return np.maximum(stiffness * (depth - (1.0 - ratio) * deepest), 0.0)


@lk.register_law
class Plastic(lk.ContactLaw):
    """Plastic normal springs, with friction and rolling resistance of Eqs. 2 and 3 and local damping."""

    name = "plastic"
    kinematics = lk.laws.Midpoint
    parts = PlasticSpring() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.LocalDamping()
