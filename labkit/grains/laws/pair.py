"""The force of one contact in one time step, from the parts of a law."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from labkit.grains.laws.bond import ParallelBond
from labkit.grains.laws.cohesion import Adhesion
from labkit.grains.laws.contact import BondHistory, Contact, ContactMotion, Response
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
    cohesion: Adhesion,
    bond: ParallelBond,
) -> Callable[..., Response]:
    """Return `pair`, the Response of a contact; the engines compile it without the parts whose numbers are None."""
    move, carry, spread = kinematics.move, kinematics.carry, compose_spread(tangential, cohesion)
    shear_stiffness, rescale, lost, drain = tangential.stiffness, tangential.rescale, tangential.loss, damping.loss
    rotate, turned = compose_rotation(kinematics, tangential, rolling, twisting), compose_turned(rolling, twisting)
    press, hold, drag = compose_press(normal, damping, cohesion), compose_hold(kinematics, bond), damping.drag

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
        cohesion: Numbers | None = None,
        bond: Numbers | None = None,
        joined: float = 0.0,
        bonded: Any = None,
    ) -> Response:
        """The Response of a contact in a time step dt, s.

        t, m: tangential force, N, and moment, N m, on a at its start; the normal part of m is that of a twisting part.
        energy: None if losses are not summed; shear to bond: see Features; then history.
        """
        n, k, ra, rb = contact.normal, contact.stiffness, contact.radius_a, contact.radius_b
        motion = move(contact, dt)
        before, joined, wide, earlier = spread(contact, dt, cohesion, joined)
        kt = shear_stiffness(shear, k, wide)
        normal, cn, ct = press(contact, shear, kt, dashpots, whole, cohesion, before, joined)
        fn, limiting, breaking_loss = normal.force, normal.limiting, normal.breaking_loss
        ft, scale, friction_loss, rolling_loss, dashpot_loss = ZERO, 0.0, 0.0, 0.0, 0.0
        turns, m = turned(contact, m, motion, rolling, twisting), rescale(m, wide, earlier)  # kr is proportional to kt
        if friction is not None:  # Eq. 2
            t = carry(t, n, motion)
            start = dot(t, t) + turns
            t = rescale(t, wide, earlier) + kt * dt * motion.slip
            squared = dot(t, t)
            limited = t if whole is None else t + ct * motion.slip
            scale = cap(dot(limited, limited), friction * limiting)
            ft = t = scale * t
            if energy is not None:
                friction_loss = lost((1.0 - scale) * scale * squared, start, shear, kt, contact, wide, earlier)
        if dashpots is not None:
            ct = drag(ct, scale) if whole is None else ct * scale
            ft = ft + ct * motion.slip if friction is not None else ct * motion.slip
            if energy is not None:
                approach, slip = -dot(n, contact.velocity), dot(motion.slip, motion.slip)
                dashpot_loss = drain(normal.elastic, fn, cn, ct, approach, slip, dt)
        if cohesion is not None:
            fn += normal.pull
        if bond is not None:
            bonded, tension, broken = hold(contact, bonded, motion, dt, bond)
            fn, ft, breaking_loss = fn - tension, ft + bonded.force, breaking_loss + broken
        force, turn = ft - fn * n, cross(n, ft)
        torque_a, torque_b = (ra - 0.5 * contact.overlap) * turn, (rb - 0.5 * contact.overlap) * turn
        if rolling is not None or twisting is not None:
            if friction is None and energy is not None:
                rolling_loss = lost(0.0, turns, shear, kt, contact, wide, earlier)
            m, rolling_loss = rotate(contact, m, motion, dt, kt, limiting, rolling_loss, energy, rolling, twisting)
            torque_a, torque_b = torque_a + m, torque_b - m
        if bond is not None:
            torque_a, torque_b = torque_a + bonded.moment, torque_b - bonded.moment
        losses = friction_loss, rolling_loss, dashpot_loss, breaking_loss
        return Response(force, torque_a, torque_b, t, m, *losses, joined, bonded)

    return pair


class NormalForce(NamedTuple):
    """The normal direction of a contact in a step.

    Args:
        force: Force of spring and dashpot, N.
        limiting: Force that limits friction and rolling, N.
        elastic: Force of the spring, N.
        pull: Force of cohesion, N.
        breaking_loss: Energy lost because the grains joined or parted, J.
    """

    force: float
    limiting: float
    elastic: float
    pull: float
    breaking_loss: float


def compose_press(
    normal: LinearSpring, damping: Dashpots, cohesion: Adhesion
) -> Callable[..., tuple[NormalForce, float, float]]:
    """Return `press`: the NormalForce, and the coefficients cn and ct of the dashpots, N s/m."""
    spring, tangent, attract = normal.force, normal.tangent, compose_attraction(cohesion)
    coefficients, push, bounding = damping.coefficients, damping.push, damping.bound

    def press(
        contact: Contact,
        shear: float,
        kt: float,
        dashpots: Numbers | None,
        whole: bool | None,
        cohesion: Numbers | None,
        before: float,
        joined: float,
    ) -> tuple[NormalForce, float, float]:
        k, ra, rb = contact.stiffness, contact.radius_a, contact.radius_b
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        elastic = spring(k, depth) if contact.overlap >= 0.0 else 0.0
        fn = bound = elastic
        cn = ct = pull = breaking_loss = 0.0
        if dashpots is not None:
            ca, cb = dashpots[2] * ra * ra * ra, dashpots[2] * rb * rb * rb
            mass = ca * cb / (ca + cb)
            cn, ct = coefficients(dashpots, shear, tangent(k, depth, mass), mass * kt, contact.overlap)
            fn = push(elastic, cn * -dot(contact.normal, contact.velocity))
            bound = bounding(elastic, fn) if whole is None else fn
        if cohesion is not None:
            pull, grip, breaking_loss = attract(contact, cohesion, before, joined)
            bound += grip
        return NormalForce(fn, abs(bound), elastic, pull, breaking_loss), cn, ct

    return press


def compose_rotation(
    kinematics: Kinematics, tangential: Coulomb, rolling: Rolling, twisting: Rolling
) -> Callable[..., tuple[Vector, float]]:
    """Return `rotate`, the new moment on the first grain and the energy lost, for the parts that resist rotation."""
    carry, divisor = kinematics.carry, tangential.divisor
    roll_stiffness, roll_limit, roll_lost = rolling.stiffness, rolling.limit, rolling.loss
    twist_stiffness, twist_limit, twist_lost = twisting.stiffness, twisting.limit, twisting.loss

    def rotate(
        contact: Contact,
        m: Vector,
        motion: ContactMotion,
        dt: float,
        kt: float,
        limiting: float,
        loss: float,
        energy: object,
        rolling: Numbers | None,
        twisting: Numbers | None,
    ) -> tuple[Vector, float]:
        n, ra, rb = contact.normal, contact.radius_a, contact.radius_b
        bend, twist = contact.spin_b - contact.spin_a, 0.0
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
                loss += roll_lost((1.0 - scale) * scale * squared, rolling, kr, divisor(kt), ra, rb)
        if twisting is not None:
            kw = twist_stiffness(twisting, kt, ra, rb)
            twist += kw * dt * dot(bend, n)
            scale = cap(twist * twist, twist_limit(twisting, ra, rb) * limiting)
            if energy is not None:
                loss += twist_lost((1.0 - scale) * scale * twist * twist, twisting, kw, divisor(kt), ra, rb)
            m += scale * twist * n
        return m, loss

    return rotate


def compose_turned(rolling: Rolling, twisting: Rolling) -> Callable[..., float]:
    """Return `turned`: the square of the moment m, N m, of rolling and twisting springs, over kr/kt, N2."""
    roll_stiffness, twist_stiffness = rolling.stiffness, twisting.stiffness

    def turned(
        contact: Contact, m: Vector, motion: ContactMotion, rolling: Numbers | None, twisting: Numbers | None
    ) -> float:
        ra, rb = contact.radius_a, contact.radius_b
        if rolling is None:
            return 0.0 if twisting is None else dot(m, m) / twist_stiffness(twisting, 1.0, ra, rb)
        kr, total = roll_stiffness(rolling, 1.0, ra, rb), 0.0
        if twisting is not None:
            twist = dot(m, motion.before)
            total = twist * twist * (1.0 / twist_stiffness(twisting, 1.0, ra, rb) - 1.0 / kr)
        return dot(m, m) / kr + total

    return turned


def compose_spread(tangential: Coulomb, cohesion: Adhesion) -> Callable[..., tuple[float, float, float, float]]:
    """Return `spread`: `joined` before and now, 1 or 0, and the overlaps, m, that give kt now and a step earlier."""
    part_at, equivalent, overlap_before = cohesion.gap, cohesion.equivalent, tangential.earlier

    def spread(
        contact: Contact, dt: float, cohesion: Numbers | None, before: float
    ) -> tuple[float, float, float, float]:
        k, ra, rb = contact.stiffness, contact.radius_a, contact.radius_b
        earlier = overlap_before(contact, dt)
        if cohesion is None:
            return before, before, contact.overlap if contact.overlap >= 0.0 else 0.0, earlier
        held = before != 0.0 and contact.overlap > -part_at(cohesion, k, ra, rb)
        joined = 1.0 if contact.overlap >= 0.0 or held else 0.0
        wide = joined * equivalent(cohesion, k, ra, rb, contact.overlap)
        return before, joined, wide, equivalent(cohesion, k, ra, rb, earlier)

    return spread


def compose_attraction(cohesion: Adhesion) -> Callable[..., tuple[float, float, float]]:
    """Return `attract`: the force of joined grains, what it adds to the limit of friction, energy lost."""
    force, energy, hold_on = cohesion.force, cohesion.energy, cohesion.grip

    def attract(contact: Contact, numbers: Numbers, before: float, joined: float) -> tuple[float, float, float]:
        k, ra, rb = contact.stiffness, contact.radius_a, contact.radius_b
        pull = joined * force(numbers, k, ra, rb, contact.overlap)
        grip = joined * hold_on(numbers, pull, ra, rb)
        lost = (abs(before) - joined) * energy(numbers, k, ra, rb, contact.overlap)
        return pull, grip, lost * dot(contact.normal, contact.normal)  # contacts that pad a block have no normal

    return attract


def compose_hold(kinematics: Kinematics, bond: ParallelBond) -> Callable[..., tuple[BondHistory, float, float]]:
    """Return `hold`: the history of a bond after a step, its tension, N, and the energy that its breaking loses, J."""
    carry, radius_of, stiffness_of, excess, energy = (
        kinematics.carry, bond.radius, bond.stiffness, bond.excess, bond.energy,
    )  # fmt: skip

    def hold(
        contact: Contact, before: BondHistory, motion: ContactMotion, dt: float, numbers: Numbers
    ) -> tuple[BondHistory, float, float]:
        n, length = contact.normal, abs(before.length)
        there = 1.0 if length > 0.0 else 0.0
        radius = radius_of(numbers, contact.radius_a, contact.radius_b)
        stiffness = stiffness_of(numbers, radius, length if length > 0.0 else radius)
        bend = contact.spin_b - contact.spin_a
        twist = dot(before.moment, motion.before)
        force = carry(before.force, n, motion) + (there * stiffness[1] * dt) * motion.slip
        moment = carry(before.moment - twist * motion.before, n, motion) + (there * stiffness[2] * dt) * across(bend, n)
        twist += there * stiffness[3] * dt * dot(bend, n)
        tension = there * stiffness[0] * (contact.radius_a + contact.radius_b - contact.overlap - length)
        shear, bending = dot(force, force), dot(moment, moment)
        whole = 1.0 if excess(numbers, radius, tension, math.sqrt(shear), math.sqrt(bending), abs(twist)) < 1.0 else 0.0
        lost = (1.0 - whole) * energy(stiffness, tension, shear, bending, twist * twist)
        history = BondHistory(whole * length, whole * force, whole * (moment + twist * n))
        return history, whole * tension, lost

    return hold
