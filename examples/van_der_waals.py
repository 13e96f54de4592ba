"""A part across a gap: the van der Waals attraction of two spheres, with a cut-off.

labkit specimen --void-ratio 0.65 --grains 500 --law van_der_waals --hamaker 1e-13 \
    --use examples/van_der_waals.py -o s.state.nc
"""

import numpy as np

import labkit as lk
from labkit.grains.laws import ZERO, Share

NEAREST, FARTHEST = 1e-7, 2e-6  # m; gap of touching grains, and that beyond which they do not attract each other


class VanDerWaals(lk.laws.LawPart):
    """F = A R*/(6 h^2) with h = gap + NEAREST; constant for grains that overlap."""

    kind = "attraction"
    central = True
    parameters = {"hamaker": lk.parameter(1e-13, unit="J", low=0.0, high=1.0, help="Hamaker's constant A")}
    history = {"attracted": lk.laws.Column("1", "1 where grains attract each other", joins=True)}

    def numbers(self, scene):
        return (scene.hamaker / 6.0,)

    def begin(self, overlap):
        return {"attracted": 1.0 * (overlap > -FARTHEST)}

    def reach(self, scene, stiffness, radius):
        return FARTHEST

    @staticmethod
    def respond(step, history, numbers, carry):
        near = 1.0 if step.contact.overlap > -FARTHEST else 0.0
        return Share(near * pull(step.contact, numbers), ZERO, ZERO, (near,), ())

    @staticmethod
    def normal_force(contact, history, numbers):
        return -history.attracted * pull(contact, numbers)

    @staticmethod
    def stored_energy(contact, history, numbers):
        gap, depth = np.maximum(-contact.overlap, 0.0), np.maximum(contact.overlap, 0.0)
        outside = strength(contact, numbers) * (1.0 / (FARTHEST + NEAREST) - 1.0 / (gap + NEAREST))
        return history.attracted * (outside - depth * pull(contact, numbers))


def strength(contact, numbers):
    """A R*/6, N m2."""
    return numbers[0] * contact.radius_a * contact.radius_b / (contact.radius_a + contact.radius_b)


def pull(contact, numbers):
    """Attraction, N."""
    distance = np.maximum(-contact.overlap, 0.0) + NEAREST
    return strength(contact, numbers) / (distance * distance)


@lk.register_law
class Attracted(lk.ContactLaw):
    """The law of the paper on grains that attract each other, without dashpots."""

    name = "van_der_waals"
    kinematics = lk.laws.Midpoint
    parts = lk.laws.LinearSpring() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.LocalDamping() + VanDerWaals()
