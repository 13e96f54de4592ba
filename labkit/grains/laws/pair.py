"""The force of one contact in one time step, composed of the parts of a law that act in a scene."""

from __future__ import annotations

import collections
import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from labkit.grains.laws.cohesion import Adhesion
from labkit.grains.laws.contact import Contact, ContactMotion, Response
from labkit.grains.laws.damping import Dashpots
from labkit.grains.laws.kinematics import FirstOrder, Midpoint
from labkit.grains.laws.normal import LinearSpring
from labkit.grains.laws.parts import Column, LawPart
from labkit.grains.laws.rolling import Rolling
from labkit.grains.laws.tangential import Coulomb
from labkit.grains.laws.vectors import ZERO, Vector, across, cap, cross, dot

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw

Kinematics = type[FirstOrder] | type[Midpoint]
Values = Any  # a named tuple of the history, the numbers or the losses of a law
named_tuple: Callable[..., Callable[..., Values]] = collections.namedtuple
SPECIAL = ("normal", "tangential", "rolling", "twisting", "damping", "cohesion")  # kinds that the others depend on


class Step(NamedTuple):
    """What the parts of a law know about a contact in a time step.

    Args:
        contact: The contact.
        motion: Its motion.
        dt: Time step, s.
        wide: Overlap that gives the tangential stiffness, m.
        earlier: That overlap in the previous step, m.
        kt: Tangential stiffness, N/m.
        limiting: Normal force that limits friction and rolling, N.
    """

    contact: Contact
    motion: ContactMotion
    dt: float
    wide: float
    earlier: float
    kt: float
    limiting: float


class Pressure(NamedTuple):
    """The normal springs and dashpots of a contact in a step.

    Args:
        force: Force of spring and dashpot, N.
        bound: Force that limits friction and rolling without cohesion, N.
        elastic: Force of the spring, N.
        cn: Coefficient of the normal dashpot, N s/m.
        ct: Coefficient of the tangential dashpot, N s/m.
    """

    force: float
    bound: float
    elastic: float
    cn: float
    ct: float


class Joint(NamedTuple):
    """What cohesion does to a contact in a step.

    Args:
        wide: Overlap that gives the tangential stiffness, m.
        earlier: That overlap in the previous step, m.
        pull: Force in addition to that of the normal part, N; negative if the grains attract each other.
        grip: Force that limits friction in addition to that of the normal part, N.
        history: The columns of the part.
        losses: Its losses, J.
    """

    wide: float
    earlier: float
    pull: float
    grip: float
    history: tuple[float, ...]
    losses: tuple[float, ...]


class Slide(NamedTuple):
    """The tangential spring of a contact in a step.

    Args:
        force: Force of the spring on a, N.
        scale: 1 for a contact that sticks, less for one that slides, 0 without friction.
        history: The columns of the part.
        losses: Its losses, J.
    """

    force: Vector
    scale: float
    history: tuple[Vector, ...]
    losses: tuple[float, ...]


class Turning(NamedTuple):
    """The rolling and twisting springs of a contact in a step.

    Args:
        moment: Moment on a, N m.
        history: The columns of the parts.
        losses: Their losses, J.
    """

    moment: Vector
    history: tuple[Vector, ...]
    losses: tuple[float, ...]


class Share(NamedTuple):
    """The response of a part of another kind, such as a bond, which the other parts do not depend on.

    Args:
        tension: Its pull along the normal, N.
        force: Its tangential force on a, N.
        moment: Its moment on a, N m; on b it is opposite.
        history: The columns of the part.
        losses: Its losses, J.
    """

    tension: float
    force: Vector
    moment: Vector
    history: tuple[Any, ...]
    losses: tuple[float, ...]


class Composition(NamedTuple):
    """The functions of a law whose parts act in a scene, and what they take and return.

    Args:
        pair: The Response of a contact: pair(contact, history, numbers, dt).
        links: Normal force of all parts but the normal one from their history alone, N; None if there is none.
        make_numbers: Type of the numbers: the named tuple that both functions take.
        make_history: Type of the history: a named tuple with a field for each column.
        columns: The columns of history: name -> Column.
        losses: Names of the losses.
        moves: True if velocities act on the contact, which may then have torques.
    """

    pair: Callable[..., Response]
    links: Callable[..., float] | None
    make_numbers: Callable[..., Values]
    make_history: Callable[..., Values]
    columns: Mapping[str, Column]
    losses: tuple[str, ...]
    moves: bool


@functools.cache
def compose(law: ContactLaw, acting: tuple[str, ...], whole: bool) -> Composition:
    """Compose the functions of a law.

    Args:
        law: The law.
        acting: Kinds of its parts that act, in the order of the law.
        whole: True if the limits of friction and rolling apply to the forces including dashpots.
    """
    parts = {kind: law.parts_by_kind[kind] for kind in acting}
    columns = {name: column for part in parts.values() for name, column in part.history.items()}
    losses = {name: None for part in parts.values() for name in part.losses}
    fields = ["shear", *(["friction"] if "tangential" in parts else []), *(k for k in acting if k not in SPECIAL[:2])]
    history = named_tuple("History", list(columns))
    return Composition(
        compose_pair(law, parts, whole, history),
        compose_links(parts),
        named_tuple("Numbers", fields),
        history,
        columns,
        tuple(losses),
        not all(part.central for part in parts.values()),
    )


def compose_pair(
    law: ContactLaw, parts: Mapping[str, LawPart], whole: bool, make_history: Callable[..., Values]
) -> Callable[..., Response]:
    """Return `pair`, the Response of a contact, for the parts of a law that act."""
    kinematics, tangential = law.kinematics, law.tangential
    cohesive, slides, damped = (kind in parts for kind in ("cohesion", "tangential", "damping"))
    turns, linked = bool(parts.keys() & {"rolling", "twisting"}), bool(parts.keys() - set(SPECIAL))
    move, shear_stiffness, drag, drain = kinematics.move, tangential.stiffness, law.damping.drag, law.damping.loss
    join = compose_join(tangential, law.cohesion if cohesive else None)
    press = compose_press(law.normal, law.damping if damped else None, whole)
    slide = compose_slide(kinematics, tangential, whole) if slides else _slide_freely
    turned, rotate = compose_turned(law, parts), compose_rotation(law, parts)
    hold = compose_share(kinematics, {kind: part for kind, part in parts.items() if kind not in SPECIAL})
    make_losses = _collect_losses(parts)

    def pair(contact: Contact, history: Values, numbers: Values, dt: float) -> Response:
        """The Response of a contact in a time step dt, s, from its history at the start of the step."""
        n, motion = contact.normal, move(contact, dt)
        joint = join(contact, history, numbers, dt)
        kt = shear_stiffness(numbers.shear, contact.stiffness, joint.wide)
        pressure = press(contact, numbers, kt)
        limiting = abs(pressure.bound + joint.grip) if cohesive else abs(pressure.bound)
        step = Step(contact, motion, dt, joint.wide, joint.earlier, kt, limiting)
        energy = turned(step, history, numbers)
        slid = slide(step, history, numbers, energy, pressure.ct)
        fn, ft, damping_loss = pressure.force, slid.force, 0.0
        if damped:
            ct = pressure.ct * slid.scale if whole else drag(pressure.ct, slid.scale)
            ft = ft + ct * motion.slip if slides else ct * motion.slip
            approach, slip = -dot(n, contact.velocity), dot(motion.slip, motion.slip)
            damping_loss = drain(pressure.elastic, fn, pressure.cn, ct, approach, slip, dt)
        if cohesive:
            fn += joint.pull
        share = hold(step, history, numbers)
        if linked:
            fn, ft = fn - share.tension, ft + share.force
        force, turn = ft - fn * n, cross(n, ft)
        half = 0.5 * contact.overlap
        torque_a, torque_b = (contact.radius_a - half) * turn, (contact.radius_b - half) * turn
        turning = rotate(step, history, numbers, energy)
        if turns:
            torque_a, torque_b = torque_a + turning.moment, torque_b - turning.moment
        if linked:
            torque_a, torque_b = torque_a + share.moment, torque_b - share.moment
        return Response(
            force,
            torque_a,
            torque_b,
            make_history(*(slid.history + turning.history + joint.history + share.history)),
            make_losses(slid.losses, turning.losses, (damping_loss,), joint.losses, share.losses),
        )

    return pair


def _collect_losses(parts: Mapping[str, LawPart]) -> Callable[..., Values]:
    """Return a function that makes the losses of a law from those of its parts, summed by name."""
    turning = "rolling" if "rolling" in parts else "twisting"
    others = [kind for kind in parts if kind not in SPECIAL]
    terms: dict[str, list[str]] = {}
    for k, group in enumerate([["tangential"], [turning], ["damping"], ["cohesion"], others]):
        names = [name for kind in group if kind in parts for name in parts[kind].losses]
        for i, name in enumerate(names):
            terms.setdefault(name, []).append(f"{'abcde'[k]}[{i}]")
    fields = [f"{name}={' + '.join(values)}" for name, values in terms.items()]
    losses = named_tuple("Losses", list(terms))
    return write_function(f"lambda a, b, c, d, e: Losses({', '.join(fields)})", Losses=losses)


def write_function(text: str, **names: object) -> Callable[..., Values]:
    """Return the function of a text; it counts as one of this file."""
    function: Callable[..., Values] = eval(compile(text, __file__, "eval"), {"__name__": __name__, **names})
    return function


def compose_links(parts: Mapping[str, LawPart]) -> Callable[..., float] | None:
    """Return the normal force of all parts but the normal one, N, from their history; for numbers and arrays."""
    function: Callable[..., float] | None = None
    for kind in parts:
        if kind not in SPECIAL[:-1]:
            function = _add_link(function, _link(kind, parts[kind]))
    return function


def _link(kind: str, part: Any) -> Callable[..., float]:
    force = part.normal_force
    own = write_function(f"lambda numbers: numbers.{kind}")

    def link(contact: Contact, history: Values, numbers: Values) -> float:
        return force(contact, history, own(numbers))

    return link


def _add_link(first: Callable[..., float] | None, second: Callable[..., float]) -> Callable[..., float]:
    if first is None:
        return second
    one = first

    def links(contact: Contact, history: Values, numbers: Values) -> float:
        return one(contact, history, numbers) + second(contact, history, numbers)

    return links


def compose_join(tangential: Coulomb, cohesion: Adhesion | None) -> Callable[..., Joint]:
    """Return `join`, the Joint of a contact."""
    overlap_before = tangential.earlier

    def touch(contact: Contact, history: Values, numbers: Values, dt: float) -> Joint:
        wide = contact.overlap if contact.overlap >= 0.0 else 0.0
        return Joint(wide, overlap_before(contact, dt), 0.0, 0.0, (), ())

    if cohesion is None:
        return touch
    part_at, equivalent = cohesion.gap, cohesion.equivalent
    force, energy, hold_on = cohesion.force, cohesion.energy, cohesion.grip

    def join(contact: Contact, history: Values, numbers: Values, dt: float) -> Joint:
        k, ra, rb, before = contact.stiffness, contact.radius_a, contact.radius_b, history.joined
        earlier = overlap_before(contact, dt)
        still = before != 0.0 and contact.overlap > -part_at(numbers.cohesion, k, ra, rb)
        joined = 1.0 if contact.overlap >= 0.0 or still else 0.0
        wide = joined * equivalent(numbers.cohesion, k, ra, rb, contact.overlap)
        pull = joined * force(numbers.cohesion, k, ra, rb, contact.overlap)
        grip = joined * hold_on(numbers.cohesion, pull, ra, rb)
        lost = (abs(before) - joined) * energy(numbers.cohesion, k, ra, rb, contact.overlap)
        lost = lost * dot(contact.normal, contact.normal)  # contacts that pad a block have no normal
        return Joint(wide, equivalent(numbers.cohesion, k, ra, rb, earlier), pull, grip, (joined,), (lost,))

    return join


def compose_press(normal: LinearSpring, damping: Dashpots | None, whole: bool) -> Callable[..., Pressure]:
    """Return `press`, the Pressure of a contact."""
    spring, tangent = normal.force, normal.tangent

    def press(contact: Contact, numbers: Values, kt: float) -> Pressure:
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        elastic = spring(contact.stiffness, depth) if contact.overlap >= 0.0 else 0.0
        return Pressure(elastic, elastic, elastic, 0.0, 0.0)

    if damping is None:
        return press
    coefficients, push, bounding = damping.coefficients, damping.push, damping.bound

    def press_damped(contact: Contact, numbers: Values, kt: float) -> Pressure:
        k, ra, rb, density = contact.stiffness, contact.radius_a, contact.radius_b, numbers.damping[2]
        depth = contact.overlap if contact.overlap >= 0.0 else 0.0
        elastic = spring(k, depth) if contact.overlap >= 0.0 else 0.0
        ca, cb = density * ra * ra * ra, density * rb * rb * rb
        mass = ca * cb / (ca + cb)
        cn, ct = coefficients(numbers.damping, numbers.shear, tangent(k, depth, mass), mass * kt, contact.overlap)
        fn = push(elastic, cn * -dot(contact.normal, contact.velocity))
        return Pressure(fn, fn if whole else bounding(elastic, fn), elastic, cn, ct)

    return press_damped


def compose_slide(kinematics: Kinematics, tangential: Coulomb, whole: bool) -> Callable[..., Slide]:
    """Return `slide`, the Slide of a contact with friction (Eq. 2)."""
    carry, rescale, lost = kinematics.carry, tangential.rescale, tangential.loss

    def slide(step: Step, history: Values, numbers: Values, energy: float, ct: float) -> Slide:
        contact, motion = step.contact, step.motion
        t = carry(history.tangential_force, contact.normal, motion)
        start = dot(t, t) + energy
        t = rescale(t, step.wide, step.earlier) + step.kt * step.dt * motion.slip
        squared = dot(t, t)
        limited = t + ct * motion.slip if whole else t
        scale = cap(dot(limited, limited), numbers.friction * step.limiting)
        slid = (1.0 - scale) * scale * squared
        loss = lost(slid, start, numbers.shear, step.kt, contact, step.wide, step.earlier)
        return Slide(scale * t, scale, (scale * t,), (loss,))

    return slide


def _slide_freely(step: Step, history: Values, numbers: Values, energy: float, ct: float) -> Slide:
    return Slide(ZERO, 0.0, (), ())


def compose_turned(law: ContactLaw, parts: Mapping[str, LawPart]) -> Callable[..., float]:
    """Return `turned`: the square of the moment of rolling and twisting springs at first, N m, over kr/kt, N2."""
    roll_stiffness, twist_stiffness = law.rolling.stiffness, law.twisting.stiffness

    def not_at_all(step: Step, history: Values, numbers: Values) -> float:
        return 0.0

    def twists(step: Step, history: Values, numbers: Values) -> float:
        ra, rb, m = step.contact.radius_a, step.contact.radius_b, history.rolling_moment
        return dot(m, m) / twist_stiffness(numbers.twisting, 1.0, ra, rb)

    def rolls(step: Step, history: Values, numbers: Values) -> float:
        ra, rb, m = step.contact.radius_a, step.contact.radius_b, history.rolling_moment
        return dot(m, m) / roll_stiffness(numbers.rolling, 1.0, ra, rb)

    def does_both(step: Step, history: Values, numbers: Values) -> float:
        ra, rb, m = step.contact.radius_a, step.contact.radius_b, history.rolling_moment
        kr, twist = roll_stiffness(numbers.rolling, 1.0, ra, rb), dot(m, step.motion.before)
        twisting = twist * twist * (1.0 / twist_stiffness(numbers.twisting, 1.0, ra, rb) - 1.0 / kr)
        return dot(m, m) / kr + twisting

    if "rolling" in parts:
        return does_both if "twisting" in parts else rolls
    return twists if "twisting" in parts else not_at_all


def compose_rotation(law: ContactLaw, parts: Mapping[str, LawPart]) -> Callable[..., Turning]:
    """Return `rotate`, the Turning of a contact, for the parts that resist rotation."""
    rolling, twisting, slides = "rolling" in parts, "twisting" in parts, "tangential" in parts
    roll, twist_by, rescale, lost = (
        compose_rolling(law.kinematics, law.rolling, law.tangential),
        compose_twisting(law.twisting, law.tangential),
        law.tangential.rescale,
        law.tangential.loss,
    )

    def rotate_freely(step: Step, history: Values, numbers: Values, energy: float) -> Turning:
        return Turning(ZERO, (), ())

    def rotate(step: Step, history: Values, numbers: Values, energy: float) -> Turning:
        m, before = rescale(history.rolling_moment, step.wide, step.earlier), step.motion.before
        twist, loss = 0.0, 0.0
        if not slides:
            loss = lost(0.0, energy, numbers.shear, step.kt, step.contact, step.wide, step.earlier)
        if twisting:
            twist = dot(m, before)
            m = m - twist * before if rolling else ZERO
        if rolling:
            m, rolling_loss = roll(step, m, numbers)
            loss += rolling_loss
        if twisting:
            twisted, twisting_loss = twist_by(step, twist, numbers)
            loss += twisting_loss
            m += twisted * step.contact.normal
        return Turning(m, (m,), (loss,))

    return rotate if rolling or twisting else rotate_freely


def compose_rolling(
    kinematics: Kinematics, rolling: Rolling, tangential: Coulomb
) -> Callable[..., tuple[Vector, float]]:
    """Return `roll`: the rolling moment at the end of a step, N m, and the energy that it loses, J (Eq. 3)."""
    carry, stiffness, limit, lost, divisor = (
        kinematics.carry, rolling.stiffness, rolling.limit, rolling.loss, tangential.divisor,
    )  # fmt: skip

    def roll(step: Step, m: Vector, numbers: Values) -> tuple[Vector, float]:
        contact, n, kt = step.contact, step.contact.normal, step.kt
        ra, rb = contact.radius_a, contact.radius_b
        m = carry(m, n, step.motion)
        kr = stiffness(numbers.rolling, kt, ra, rb)
        m += kr * step.dt * across(contact.spin_b - contact.spin_a, n)
        squared = dot(m, m)
        scale = cap(squared, limit(numbers.rolling, ra, rb) * step.limiting)
        return scale * m, lost((1.0 - scale) * scale * squared, numbers.rolling, kr, divisor(kt), ra, rb)

    return roll


def compose_twisting(twisting: Rolling, tangential: Coulomb) -> Callable[..., tuple[float, float]]:
    """Return `twist_by`: the twisting moment at the end of a step, N m, and the energy that it loses, J."""
    stiffness, limit, lost, divisor = twisting.stiffness, twisting.limit, twisting.loss, tangential.divisor

    def twist_by(step: Step, twist: float, numbers: Values) -> tuple[float, float]:
        contact, kt = step.contact, step.kt
        ra, rb = contact.radius_a, contact.radius_b
        kw = stiffness(numbers.twisting, kt, ra, rb)
        twist += kw * step.dt * dot(contact.spin_b - contact.spin_a, contact.normal)
        scale = cap(twist * twist, limit(numbers.twisting, ra, rb) * step.limiting)
        return scale * twist, lost((1.0 - scale) * scale * twist * twist, numbers.twisting, kw, divisor(kt), ra, rb)

    return twist_by


def compose_share(kinematics: Kinematics, parts: Mapping[str, Any]) -> Callable[..., Share]:
    """Return `hold`: the sum of the Shares of parts of other kinds."""
    function = _hold_nothing
    for kind, part in parts.items():
        own = _share(kinematics, kind, part)
        function = own if function is _hold_nothing else _add_share(function, own)
    return function


def _hold_nothing(step: Step, history: Values, numbers: Values) -> Share:
    return Share(0.0, ZERO, ZERO, (), ())


def _share(kinematics: Kinematics, kind: str, part: Any) -> Callable[..., Share]:
    respond, carry = part.respond, kinematics.carry
    own = write_function(f"lambda numbers: numbers.{kind}")

    def share(step: Step, history: Values, numbers: Values) -> Share:
        return respond(step, history, own(numbers), carry)

    return share


def _add_share(first: Callable[..., Share], second: Callable[..., Share]) -> Callable[..., Share]:
    def share(step: Step, history: Values, numbers: Values) -> Share:
        a, b = first(step, history, numbers), second(step, history, numbers)
        forces = a.tension + b.tension, a.force + b.force, a.moment + b.moment
        return Share(*forces, a.history + b.history, a.losses + b.losses)

    return share
