"""The normalised contact force f~ (below Eq. 18) and Lambda = f~/E of each contact side, and strong contacts.

A contact has two sides, one on each grain; the force is the same there, the normalised force is not when the
grains differ in size.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.snapshot import Snapshot, contact_arms


def normalisation(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """f~/f = |l|/v = 3 lambda'/(pi D^2) of each side (below Eq. 18), shape (n, 2), 1/m2.

    `volume` (grain,) m3: v of each grain, of the sphere if not given. Grains of a plane layer are discs there:
    v = pi D^2/4 times the thickness of the layer, and f~/f = 2 lambda'/(pi D thickness).
    """
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3 if volume is None else volume
    return contact_arms(snapshot) / volume[snapshot.contacts.grain]


def normalised_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """f~ = 3 lambda' f/(pi D^2) on the grain of each side (below Eq. 18), shape (n, 2, 3), Pa.

    f is the force on that grain, so that the two sides point in opposite directions. `volume`: as for
    `normalisation`.
    """
    force = snapshot.contacts.force_on_first()
    both = np.stack([force, -force], axis=1)
    return normalisation(snapshot, volume)[:, :, None] * both


def normalised_normal_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Lambda_n = 3 lambda' f_n/(pi D^2 E) of each side (Eq. 22), shape (n, 2). `volume`: as for `normalisation`."""
    return normalisation(snapshot, volume) * (snapshot.contacts.normal_force / snapshot.young_modulus)[:, None]


def strong_by_force(snapshot: Snapshot) -> np.ndarray:
    """Strong contacts as usually defined: f_n above its mean, shape (n, 2) of bool, equal on both sides."""
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.zeros((0, 2), dtype=bool)
    strong = contacts.normal_force > contacts.normal_force.mean()
    return np.stack([strong, strong], axis=1)


def strong_by_normalised_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Strong contacts after section 3: f~_n above its mean over the sides, shape (n, 2) of bool.

    `volume`: as for `normalisation`.
    """
    size = normalisation(snapshot, volume) * snapshot.contacts.normal_force[:, None]
    return size > size.mean() if size.size else np.zeros((0, 2), dtype=bool)


@dataclasses.dataclass(frozen=True)
class Vectors:
    """What C0 and its relatives average: a row is a contact side, or a contact with the mean of its two sides.

    normal (m, 3): n, from the first to the second grain on either side: n n and n (x) Lambda are even in n;
    normal_component (m,): Lambda_n; tangential (m, 3): Lambda_t on the first grain (above Eq. 22).
    """

    normal: np.ndarray
    normal_component: np.ndarray
    tangential: np.ndarray

    def __len__(self) -> int:
        return len(self.normal_component)


def vectors_of_contacts(snapshot: Snapshot, volume: np.ndarray | None = None) -> Vectors:
    """Vectors with a row for each contact, Lambda the mean of its two sides: averages are those over the sides.

    `volume`: as for `normalisation`.
    """
    contacts = snapshot.contacts
    weight = 0.5 * normalisation(snapshot, volume).sum(axis=1) / snapshot.young_modulus
    return Vectors(contacts.normal, weight * contacts.normal_force, weight[:, None] * contacts.tangential_force)


def vectors_of_sides(snapshot: Snapshot, side: np.ndarray, weight: np.ndarray) -> Vectors:
    """Vectors of chosen sides. `side` (n, 2) of bool; `weight` (n, 2): Lambda over f of each side, 1/N."""
    contacts = snapshot.contacts
    row, _ = np.nonzero(side)
    weight = weight[side]
    return Vectors(
        contacts.normal[row], weight * contacts.normal_force[row], weight[:, None] * contacts.tangential_force[row]
    )
