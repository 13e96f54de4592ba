"""The force of a contact in a time step, composed of the parts of a law that act in a scene."""

from __future__ import annotations

import collections
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from labkit.errors import InputError
from labkit.grains.laws.cohesion import compose_cohesive_forces
from labkit.grains.laws.contact import Contact, ContactStep, Response, Share, Values
from labkit.grains.laws.forces import compose_energy, compose_normal_force
from labkit.grains.laws.kinematics import Kinematics
from labkit.grains.laws.normal import compose_normal_forces
from labkit.grains.laws.parts import BREAKING, SPECIAL, WITHOUT_NORMAL_FORCE, Column, LawPart, write_function
from labkit.grains.laws.rolling import compose_moment_squared, compose_moments
from labkit.grains.laws.tangential import compose_tangential_forces, no_tangential_forces
from labkit.grains.laws.vectors import ZERO, cross, dot
from labkit.once import once

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw

named_tuple: Callable[..., Callable[..., Values]] = collections.namedtuple
MOST_LOSSES = 7  # rows that the kernel has for losses


class Composition(NamedTuple):
    """The functions composed of the parts of a law that act in a scene, and the types of their arguments.

    Args:
        pair: pair(contact, history, numbers, dt) returns the Response of a contact.
        normal_force: normal_force(contact, history, numbers) returns the normal force (N) at one instant.
        stored_energy: stored_energy(contact, history, numbers) returns the energy (J) at one instant.
        make_numbers: Type of the argument `numbers`: a named tuple of parameters.
        make_history: Type of the argument `history`: a named tuple with a field for each column.
        columns: The columns of history: name -> Column.
        losses: Names of the losses.
        moves: True if the force depends on velocities and spins, or the contact has torques.
        by_radii: True if the normal force may also depend on the radii of the grains.
    """

    pair: Callable[..., Response]
    normal_force: Callable[..., float]
    stored_energy: Callable[..., float]
    make_numbers: Callable[..., Values]
    make_history: Callable[..., Values]
    columns: Mapping[str, Column]
    losses: tuple[str, ...]
    moves: bool
    by_radii: bool


@once
def compose_law(law: ContactLaw, acting: tuple[str, ...], whole: bool) -> Composition:
    """Compose the functions of a law.

    Args:
        law: The law.
        acting: Kinds of the parts that act in the scene, in the order of the law.
        whole: True if the limits of friction and rolling apply to forces that include the dashpots.
    """
    parts = {kind: law.parts_by_kind[kind] for kind in acting}
    columns = {name: column for part in parts.values() for name, column in part.history.items()}
    losses = {name: None for part in parts.values() for name in part.losses}
    if len(losses) > MOST_LOSSES:
        raise InputError(f"a contact law has {len(losses)} losses ({', '.join(losses)}): give at most {MOST_LOSSES}")
    fields = ["shear", *(["friction"] if "tangential" in parts else []), *(k for k in acting if k != "tangential")]
    history = named_tuple("History", list(columns))
    return Composition(
        compose_pair(law, parts, whole, history),
        compose_normal_force(parts),
        compose_energy(law, parts),
        named_tuple("Numbers", fields),
        history,
        columns,
        tuple(losses),
        not all(part.central for part in parts.values()),
        bool(parts.keys() - {"normal", *WITHOUT_NORMAL_FORCE}) or bool(law.normal.history),
    )


def compose_pair(
    law: ContactLaw, parts: Mapping[str, LawPart], whole: bool, make_history: Callable[..., Values]
) -> Callable[..., Response]:
    """Return `pair`, which computes the Response of a contact from the parts that act in a scene."""
    kinematics, tangential = law.kinematics, law.tangential
    cohesive, slides, damped = (kind in parts for kind in ("cohesion", "tangential", "damping"))
    turns, linked = bool(parts.keys() & {"rolling", "twisting"}), bool(parts.keys() - set(SPECIAL))
    move, shear_stiffness = kinematics.move, tangential.stiffness
    tangential_coefficient, loss_of_dashpots = law.damping.tangential_coefficient, law.damping.loss
    cohesive_forces = compose_cohesive_forces(tangential, law.cohesion if cohesive else None)
    normal_forces = compose_normal_forces(law.normal, law.damping if damped else None, whole)
    tangential_forces, jumps = (
        no_tangential_forces,
        any(BREAKING.items() <= part.losses.items() for part in parts.values()),
    )
    if slides:
        tangential_forces = compose_tangential_forces(kinematics, tangential, whole, jumps)
    moment_squared, moments = compose_moment_squared(law, parts), compose_moments(law, parts)
    other_shares = compose_share(kinematics, {kind: part for kind, part in parts.items() if kind not in SPECIAL})
    make_losses = _collect_losses(parts)

    def pair(contact: Contact, history: Values, numbers: Values, dt: float) -> Response:
        """Return the Response of a contact in a time step dt (s) from its history at the start of the step."""
        n, motion = contact.normal, move(contact, dt)
        cohesion = cohesive_forces(contact, history, numbers, dt)
        kt = shear_stiffness(numbers.shear, contact.stiffness, cohesion.wide)
        normal = normal_forces(contact, history, numbers, kt)
        limiting = abs(normal.limiting + cohesion.limiting) if cohesive else abs(normal.limiting)
        step = ContactStep(contact, motion, dt, cohesion.wide, cohesion.earlier, kt, limiting)
        squared = moment_squared(contact, motion.before, history, numbers)
        shear = tangential_forces(step, history, numbers, squared, normal.ct)
        fn, ft, damping_loss = normal.force, shear.force, 0.0
        if damped:
            ct = normal.ct * shear.scale if whole else tangential_coefficient(normal.ct, shear.scale)
            ft = ft + ct * motion.slip if slides else ct * motion.slip
            approach, slip = -dot(n, contact.velocity), dot(motion.slip, motion.slip)
            damping_loss = loss_of_dashpots(normal, ct, approach, slip, dt)
        if cohesive:
            fn += cohesion.pull
        share = other_shares(step, history, numbers)
        if linked:
            fn, ft = fn - share.tension, ft + share.force
        force, turn = ft - fn * n, cross(n, ft)
        half = 0.5 * contact.overlap
        torque_a, torque_b = (contact.radius_a - half) * turn, (contact.radius_b - half) * turn
        turning = moments(step, history, numbers, squared)
        if turns:
            torque_a, torque_b = torque_a + turning.moment, torque_b - turning.moment
        if linked:
            torque_a, torque_b = torque_a + share.moment, torque_b - share.moment
        return Response(
            force,
            torque_a,
            torque_b,
            make_history(*(normal.history + shear.history + turning.history + cohesion.history + share.history)),
            make_losses(normal.losses, shear.losses, turning.losses, (damping_loss,), cohesion.losses, share.losses),
        )

    return pair


def _collect_losses(parts: Mapping[str, LawPart]) -> Callable[..., Values]:
    """Return a function that sums the losses of all parts by name."""
    turning = "rolling" if "rolling" in parts else "twisting"
    others = [kind for kind in parts if kind not in SPECIAL]
    terms: dict[str, list[str]] = {}
    for k, group in enumerate([["normal"], ["tangential"], [turning], ["damping"], ["cohesion"], others]):
        names = [name for kind in group if kind in parts for name in parts[kind].losses]
        for i, name in enumerate(names):
            terms.setdefault(name, []).append(f"{'abcdef'[k]}[{i}]")
    fields = [f"{name}={' + '.join(values)}" for name, values in terms.items()]
    losses = named_tuple("Losses", list(terms))
    return write_function(f"lambda a, b, c, d, e, f: Losses({', '.join(fields)})", Losses=losses)


def compose_share(kinematics: Kinematics, parts: Mapping[str, LawPart]) -> Callable[..., Share]:
    """Return `other_shares`, which sums the Shares of all parts on which no other part depends."""
    function = _no_share
    for kind, part in parts.items():
        share = _share(kinematics, kind, part)
        function = share if function is _no_share else _add_share(function, share)
    return function


def _no_share(step: ContactStep, history: Values, numbers: Values) -> Share:
    return Share(0.0, ZERO, ZERO, (), ())


def _share(kinematics: Kinematics, kind: str, part: Any) -> Callable[..., Share]:
    respond, carry = part.respond, kinematics.carry
    from_numbers = write_function(f"lambda numbers: numbers.{kind}")

    def share(step: ContactStep, history: Values, numbers: Values) -> Share:
        return respond(step, history, from_numbers(numbers), carry)

    return share


def _add_share(first: Callable[..., Share], second: Callable[..., Share]) -> Callable[..., Share]:
    def share(step: ContactStep, history: Values, numbers: Values) -> Share:
        a, b = first(step, history, numbers), second(step, history, numbers)
        forces = a.tension + b.tension, a.force + b.force, a.moment + b.moment
        return Share(*forces, a.history + b.history, a.losses + b.losses)

    return share
