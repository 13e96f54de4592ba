"""A user-defined contact law made of labkit's parts: linear springs with Coulomb friction, no rolling resistance.

labkit specimen --void-ratio 0.6 --grains 500 --law linear --use examples/own_law.py -o s.state.nc
"""

import labkit as lk


@lk.register_law
class Linear(lk.ContactLaw):
    """fn = kn delta, |ft| <= mu fn, with local damping."""

    name = "linear"
    parts = lk.laws.LinearSpring() + lk.laws.Coulomb() + lk.laws.LocalDamping()
