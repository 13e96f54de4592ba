"""Force and energy of the links of contacts, those of cohesion and bonds, for records and the energy balance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

from labkit.io.links import BOND_FORCE, BOND_LENGTH, BOND_MOMENT, JOINED, no_links

if TYPE_CHECKING:
    from labkit.grains.laws.law import ContactLaw
    from labkit.grains.scene import Scene
    from labkit.micro.snapshot import Contacts


def on_arrays(function: Callable[..., object]) -> Callable[..., np.ndarray]:
    """Apply a part's function, which is written for numbers, to arrays."""
    return cast(Callable[..., np.ndarray], function)


def reach(law: ContactLaw, scene: Scene, radius: float) -> float:
    """Largest gap across which two grains of this radius, m, act on each other, m."""
    gap = 0.0
    if "cohesion" in law.has:
        stiffness = float(law.normal_stiffness(scene, np.asarray(radius), np.asarray(radius)))
        gap = law.cohesion.gap(law.cohesion.numbers(scene), stiffness, radius, radius)
    return float(max(gap, law.bond.gap(scene, radius)) if "bond" in law.has else gap)


def bond_stiffness(
    law: ContactLaw, scene: Scene, a: np.ndarray, b: np.ndarray, length: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    """Stiffness of bonds (see ParallelBond.stiffness), as long as the distance of touching grains without a `length`.

    Radii and lengths in m, (n,). A length of 0, without a bond, gives that of touching grains.
    """
    numbers = law.bond.numbers(scene)
    length = a + b if length is None else np.where(length > 0.0, length, a + b)
    stiffness = law.bond.stiffness(
        numbers, law.bond.radius(numbers, cast(float, a), cast(float, b)), cast(float, length)
    )
    return cast("tuple[np.ndarray, ...]", stiffness)


def normal_force(
    law: ContactLaw, scene: Scene, a: np.ndarray, b: np.ndarray, overlap: np.ndarray, joints: np.ndarray | None
) -> np.ndarray:
    """Normal force of links, N, compression positive, (n,).

    Args:
        law: The contact law.
        scene: The scene.
        a: Radii of the first grains, (n,), m.
        b: Radii of the second grains, (n,), m.
        overlap: Overlaps, (n,), m.
        joints: Links, (n, 8); None if all that overlap are joined, and none is bonded.
    """
    joints = no_links(len(overlap), overlap >= 0.0) if joints is None else joints
    force = np.zeros(len(overlap))
    if "cohesion" in law.has:
        numbers = law.cohesion.numbers(scene)
        force += joints[:, JOINED] * on_arrays(law.cohesion.force)(
            numbers, law.normal_stiffness(scene, a, b), a, b, overlap
        )
    if "bond" in law.has:
        force -= _tension(law, scene, a, b, overlap, joints)
    return force


def energy(law: ContactLaw, scene: Scene, a: np.ndarray, b: np.ndarray, contacts: Contacts) -> float:
    """Energy of the links of contacts, J; radii of their grains in m, (n,)."""
    overlap, stored = contacts.overlap, np.zeros(len(contacts))
    joints = no_links(len(overlap), overlap >= 0.0) if contacts.links is None else contacts.links
    if "cohesion" in law.has:
        numbers = law.cohesion.numbers(scene)
        stored += joints[:, JOINED] * on_arrays(law.cohesion.energy)(
            numbers, law.normal_stiffness(scene, a, b), a, b, overlap
        )
    if "bond" in law.has:
        force, moment = joints[:, BOND_FORCE], joints[:, BOND_MOMENT]
        torsion = np.einsum("ci,ci->c", moment, contacts.normal) ** 2
        bending = np.einsum("ci,ci->c", moment, moment) - torsion
        stiffness = bond_stiffness(law, scene, a, b, joints[:, BOND_LENGTH])
        tension = _tension(law, scene, a, b, overlap, joints)
        stored += on_arrays(law.bond.energy)(stiffness, tension, np.einsum("ci,ci->c", force, force), bending, torsion)
    return float(stored.sum())


def _tension(
    law: ContactLaw, scene: Scene, a: np.ndarray, b: np.ndarray, overlap: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """Tension of bonds, N; 0 for contacts without one."""
    length = joints[:, BOND_LENGTH]
    elongation = np.where(length > 0.0, a + b - overlap - length, 0.0)
    return bond_stiffness(law, scene, a, b, length)[0] * elongation
