"""A user-defined contact law: linear springs with Coulomb friction, no rolling resistance; for the fused engine.

labkit specimen --void-ratio 0.6 --grains 500 --law linear --engine fused --use examples/own_law.py -o s.state.nc
"""

import labkit as lk
from labkit.dem.laws import Response
from labkit.dem.laws.vectors import ZERO, cap, cross, dot, minus, plus, times


@lk.register_law
class Linear(lk.ContactLaw):
    """fn = kn delta, |ft| <= mu fn. Stiffnesses, elastic energy and time step are inherited from lk.ContactLaw."""

    name = "linear"

    @staticmethod
    def pair(contact, t, m, dt, constants, friction, rolling, dashpots, energy):
        """One contact in one time step; `t` is the tangential force at its start. See lk.ContactLaw.pair."""
        n, loss, turn = contact.normal, 0.0, ZERO
        fn = contact.stiffness * contact.overlap if contact.overlap > 0.0 else 0.0
        force = times(-fn, n)
        if friction is not None:
            kt = constants[0] * contact.stiffness  # constants = (kt/kn,), see lk.ContactLaw.features
            spin = plus(times(contact.radius_a, contact.spin_a), times(contact.radius_b, contact.spin_b))
            slip = minus(contact.velocity, cross(spin, n))
            t = plus(minus(t, times(dot(t, n), n)), times(kt * dt, minus(slip, times(dot(slip, n), n))))
            squared = dot(t, t)
            scale = cap(squared, friction * fn)
            t = times(scale, t)
            loss = (1.0 - scale) * scale * squared / kt
            force, turn = plus(force, t), cross(n, t)
        arms = contact.radius_a - 0.5 * contact.overlap, contact.radius_b - 0.5 * contact.overlap
        return Response(force, times(arms[0], turn), times(arms[1], turn), t, m, loss, 0.0, 0.0)
