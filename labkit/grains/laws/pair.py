"""The force of one contact in one time step, from the parts of a law."""

from __future__ import annotations

from collections.abc import Callable

from labkit.grains.laws.contact import Contact, ContactMotion, Response
from labkit.grains.laws.damping import Dashpots
from labkit.grains.laws.kinematics import FirstOrder, Midpoint
from labkit.grains.laws.normal import LinearSpring
from labkit.grains.laws.parts import Numbers
from labkit.grains.laws.rolling import Rolling
from labkit.grains.laws.tangential import Coulomb
from labkit.grains.laws.vectors import ZERO, Vector, across, cap, cross, dot

Kinematics = type[FirstOrder] | type[Midpoint]


def compose_pair(
    kinematics: Kinematics,
    normal: LinearSpring,
    tangential: Coulomb,
    rolling: Rolling,
    twisting: Rolling,
    damping: Dashpots,
) -> Callable[..., Response]:
    """Return `pair`, the Response of a contact, for the parts of a law.

    `pair` is plain Python, which the engines also compile, without the code of parts whose numbers are None.
    """
    move, carry = kinematics.move, kinematics.carry
    spring, tangent = normal.force, normal.tangent
    shear_stiffness, rescale, friction_lost = tangential.stiffness, tangential.rescale, tangential.loss
    rotate, roll_stiffness = compose_rotation(kinematics, rolling, twisting), rolling.stiffness
    coefficients, push, bounding, drag = damping.coefficients, damping.push, damping.bound, damping.drag
    dashpot_lost = damping.loss

    def pair(
        contact: Contact,
        t: Vector,
        m: Vector,
        dt: float,
        energy: object,
        shear: float,
        friction: float | None,
        rolling: Numbers | None,
        twisting: Numbers | None,
        dashpots: Numbers | None,
        whole: bool | None,
    ) -> Response:
        """The Response of a contact.

        t, m: tangential force, N, and moment, N m, at the start of the step, acting on a. The moment of a twisting part
        is the normal component of m. dt: time step, s; energy: None if losses are not summed; shear to whole: see
        Features.
        """
        n, k, ra, rb = contact.normal, contact.stiffness, contact.radius_a, contact.radius_b
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        motion = move(contact, dt)
        kt = shear_stiffness(shear, k, depth)
        elastic = spring(k, depth) if contact.overlap >= 0.0 else 0.0
        fn = bound = elastic
        ft, scale = ZERO, 0.0
        friction_loss = rolling_loss = dashpot_loss = 0.0
        if dashpots is not None:
            ca, cb = dashpots[2] * ra * ra * ra, dashpots[2] * rb * rb * rb
            mass = ca * cb / (ca + cb)
            cn, ct = coefficients(dashpots, shear, tangent(k, depth, mass), mass * kt, contact.overlap)
            approach = -dot(n, contact.velocity)
            fn = push(elastic, cn * approach)
            bound = bounding(elastic, fn) if whole is None else fn
        limiting = abs(bound)
        if friction is not None:  # Eq. 2
            t = carry(t, n, motion)
            before = dot(t, t)
            if rolling is not None:  # kr changes as kt does
                before += dot(m, m) / roll_stiffness(rolling, 1.0, ra, rb)
            t = rescale(t, contact, dt) + kt * dt * motion.slip
            squared = dot(t, t)
            limited = t if whole is None else t + ct * motion.slip
            scale = cap(dot(limited, limited), friction * limiting)
            t = scale * t
            ft = t
            if energy is not None:
                friction_loss = friction_lost((1.0 - scale) * scale * squared, before, shear, kt, contact, dt)
        if dashpots is not None:
            ct = drag(ct, scale) if whole is None else ct * scale
            ft = ft + ct * motion.slip if friction is not None else ct * motion.slip
            if energy is not None:
                dashpot_loss = dashpot_lost(elastic, fn, cn, ct, approach, dot(motion.slip, motion.slip), dt)
        force, turn = ft - fn * n, cross(n, ft)
        torque_a, torque_b = (ra - 0.5 * contact.overlap) * turn, (rb - 0.5 * contact.overlap) * turn
        if rolling is not None or twisting is not None:
            m, rolling_loss = rotate(contact, m, motion, dt, kt, limiting, energy, rolling, twisting)
            torque_a, torque_b = torque_a + m, torque_b - m
        return Response(force, torque_a, torque_b, t, m, friction_loss, rolling_loss, dashpot_loss)

    return pair


def compose_rotation(
    kinematics: Kinematics, rolling: Rolling, twisting: Rolling
) -> Callable[..., tuple[Vector, float]]:
    """Return `rotate`, the new moment on the first grain and the energy lost, for the parts that resist rotation."""
    carry = kinematics.carry
    roll_stiffness, roll_limit, roll_lost = rolling.stiffness, rolling.limit, rolling.loss
    twist_stiffness, twist_limit, twist_lost = twisting.stiffness, twisting.limit, twisting.loss

    def rotate(
        contact: Contact,
        m: Vector,
        motion: ContactMotion,
        dt: float,
        kt: float,
        limiting: float,
        energy: object,
        rolling: Numbers | None,
        twisting: Numbers | None,
    ) -> tuple[Vector, float]:
        n, ra, rb = contact.normal, contact.radius_a, contact.radius_b
        bend = contact.spin_b - contact.spin_a
        loss, twist = 0.0, 0.0
        if twisting is not None:
            twist = dot(m, motion.before)
            m = m - twist * motion.before if rolling is not None else ZERO
        if rolling is not None:  # Eq. 3
            m = carry(m, n, motion)
            kr = roll_stiffness(rolling, kt, ra, rb)
            m += kr * dt * across(bend, n)
            squared = dot(m, m)
            scale = cap(squared, roll_limit(rolling, ra, rb) * limiting)
            m = scale * m
            if energy is not None:
                loss = roll_lost((1.0 - scale) * scale * squared, rolling, kr, kt, ra, rb)
        if twisting is not None:
            kw = twist_stiffness(twisting, kt, ra, rb)
            twist += kw * dt * dot(bend, n)
            scale = cap(twist * twist, twist_limit(twisting, ra, rb) * limiting)
            if energy is not None:
                loss += twist_lost((1.0 - scale) * scale * twist * twist, twisting, kw, kt, ra, rb)
            m += scale * twist * n
        return m, loss

    return rotate
