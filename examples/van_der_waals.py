"""A user-defined part across a gap: the van der Waals attraction of two spheres, with a cut-off.

labkit specimen --void-ratio 0.65 --grains 500 --law van_der_waals --use examples/van_der_waals.py -o s.state.nc
"""

import labkit as lk

HAMAKER = 1e-13  # J; large, so that grains of 0.17 mm feel it
NEAREST, FARTHEST = 1e-7, 2e-6  # m; gap of touching grains, and that beyond which they do not attract each other


class VanDerWaals(lk.laws.LawPart):
    """F = A R*/(6 h^2) with h = gap + NEAREST, that of touching grains if they overlap, 0 beyond FARTHEST."""

    kind = "attraction"
    central = True
    history = {"attracted": lk.laws.Column("1", "1 where grains attract each other", joins=True)}

    def reach(self, scene, stiffness, radius):
        """Largest gap across which grains act on each other, m."""
        return FARTHEST

    @staticmethod
    def respond(step, history, numbers, carry):
        """The Share of the attraction in a time step."""
        contact = step.contact
        near = 1.0 if contact.overlap > -FARTHEST else 0.0
        return lk.laws.Share(near * pull(contact), lk.laws.ZERO, lk.laws.ZERO, (near,), ())

    @staticmethod
    def normal_force(contact, history, numbers):
        """Normal force, N, compression positive."""
        return -history.attracted * pull(contact)

    @staticmethod
    def stored_energy(contact, history, numbers):
        """Energy, J, zero at FARTHEST."""
        gap, factor = lk.laws.maximum(-contact.overlap, 0.0), hamaker(contact)
        outside = factor * (1.0 / (FARTHEST + NEAREST) - 1.0 / (gap + NEAREST))
        return history.attracted * (outside - lk.laws.maximum(contact.overlap, 0.0) * pull(contact))


def hamaker(contact):
    """A R*/6, N m2."""
    return HAMAKER / 6.0 * contact.radius_a * contact.radius_b / (contact.radius_a + contact.radius_b)


def pull(contact):
    """Attraction of two grains, N."""
    distance = lk.laws.maximum(-contact.overlap, 0.0) + NEAREST
    return hamaker(contact) / (distance * distance)


@lk.register_law
class Attracted(lk.ContactLaw):
    """The law of the paper, without dashpots, on grains that attract each other."""

    name = "van_der_waals"
    kinematics = lk.laws.Midpoint
    parts = lk.laws.LinearSpring() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.LocalDamping() + VanDerWaals()
