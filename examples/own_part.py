"""A user-defined part of a contact law: DMT adhesion, a constant pull-off force 2 pi W R* while the grains touch.

labkit specimen --void-ratio 0.7 --grains 500 --law adhesive --use examples/own_part.py -o s.state.nc
"""

import labkit as lk

REST = 2.0 * 3.0 / 0.15e9  # m; overlap 2 W/E of a pair at rest, for W = 3 J/m2 and E = 0.15 GPa


class Adhesion(lk.laws.LinearSpring):
    """fn = kn delta - 2 pi W R* with kn = pi E R*."""

    @staticmethod
    def force(stiffness, overlap):
        """Elastic normal force, N."""
        return stiffness * (overlap - REST)

    @staticmethod
    def energy(stiffness, overlap):
        """Stored energy, J; labkit checks that `force` is its derivative."""
        return stiffness * overlap * (0.5 * overlap - REST)


@lk.register_law
class Adhesive(lk.ContactLaw):
    """The law of the paper with adhesion."""

    name = "adhesive"
    kinematics = lk.laws.Midpoint
    parts = Adhesion() + lk.laws.Coulomb() + lk.laws.Rolling() + lk.laws.Dashpots()
