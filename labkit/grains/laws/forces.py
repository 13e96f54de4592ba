"""Forces and energies of contacts at one instant, equal to those of the law in a time step of 0 s without dashpots.

They are functions of the overlaps and the contact history. Snapshots and records evaluate them for arrays. The engines
compile the normal force, from which the servo computes the stress.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from labkit.grains.laws.cohesion import compose_wide
from labkit.grains.laws.contact import Contact, Values
from labkit.grains.laws.parts import WITHOUT_NORMAL_FORCE, LawPart, write_function
from labkit.grains.laws.rolling import compose_moment_squared
from labkit.grains.laws.vectors import dot

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw


def compose_normal_force(parts: Mapping[str, LawPart]) -> Callable[..., float]:
    """Return a function (contact, history, numbers) that returns the normal force (N), compression positive."""
    return _sum_parts(parts, "normal_force")


def compose_energy(law: ContactLaw, parts: Mapping[str, LawPart]) -> Callable[..., float]:
    """Return a function (contact, history, numbers) that returns the energy stored in a contact (J)."""
    stored, slides = _sum_parts(parts, "stored_energy"), "tangential" in parts
    if not slides and not parts.keys() & {"rolling", "twisting"}:
        return stored
    stiffness, divisor = law.tangential.stiffness, law.tangential.divisor
    wide, moment_squared = (
        compose_wide(law.cohesion if "cohesion" in parts else None),
        compose_moment_squared(law, parts),
    )

    def stored_energy(contact: Contact, history: Values, numbers: Values) -> float:
        kt = stiffness(numbers.shear, contact.stiffness, wide(contact, history, numbers))
        squared = moment_squared(contact, contact.normal, history, numbers)
        if slides:
            squared = squared + dot(history.tangential_force, history.tangential_force)
        return stored(contact, history, numbers) + 0.5 * squared / divisor(kt)

    return stored_energy


def _sum_parts(parts: Mapping[str, LawPart], name: str) -> Callable[..., float]:
    """Return the sum of the functions `name` of all parts except tangential, rolling, twisting and damping parts."""
    functions = {kind: getattr(part, name) for kind, part in parts.items() if kind not in WITHOUT_NORMAL_FORCE}
    terms = [f"{kind}(contact, history, numbers.{kind})" for kind in functions]
    return write_function(f"lambda contact, history, numbers: {' + '.join(terms)}", **functions)
