"""Normalised contact force f~ (below Eq. 18) and Lambda = f~/E of each contact side, and strong contacts.

A contact has two sides, one on each grain. The magnitude of the force is the same on both; that of the normalised force
differs if the grains differ in size.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.snapshot import Snapshot, contact_arms


def normalisation(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Normalisation factor f~/f = |l|/v = 3 lambda'/(pi D^2) of each side (below Eq. 18), shape (n, 2), 1/m2.

    In a planar layer, grains are discs: with v = pi D^2/4 times the thickness of the layer,
    f~/f = 2 lambda'/(pi D thickness).

    Args:
        snapshot: The snapshot.
        volume: v of each grain, (grain,), m3 (default: the volume of the sphere).
    """
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3 if volume is None else volume
    return contact_arms(snapshot) / volume[snapshot.contacts.grain]


def normalised_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Normalised force f~ = 3 lambda' f/(pi D^2) on each side (below Eq. 18), shape (n, 2, 3), Pa.

    f is the force on the grain of that side; the forces on the two sides are opposite. `volume`: see `normalisation`.
    """
    force = snapshot.contacts.force_on_first()
    both = np.stack([force, -force], axis=1)
    return normalisation(snapshot, volume)[:, :, None] * both


def normalised_normal_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Lambda_n = 3 lambda' f_n/(pi D^2 E) of each side (Eq. 22), shape (n, 2). `volume`: see `normalisation`."""
    return normalisation(snapshot, volume) * (snapshot.contacts.normal_force / snapshot.young_modulus)[:, None]


def strong_by_force(snapshot: Snapshot) -> np.ndarray:
    """Strong contacts by the usual definition, f_n above its mean; shape (n, 2) of bool, equal on both sides."""
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.zeros((0, 2), dtype=bool)
    strong = contacts.normal_force > contacts.normal_force.mean()
    return np.stack([strong, strong], axis=1)


def strong_by_normalised_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Strong contacts as defined in section 3, f~_n above its mean over all sides; shape (n, 2) of bool.

    `volume`: see `normalisation`.
    """
    size = normalisation(snapshot, volume) * snapshot.contacts.normal_force[:, None]
    return size > size.mean() if size.size else np.zeros((0, 2), dtype=bool)


@dataclasses.dataclass(frozen=True)
class Vectors:
    """Normalised forces that C0 and related equations average. A row is a contact side, or the mean of both sides.

    Args:
        normal: n, from the first to the second grain for both sides, because n n and n (x) Lambda are even in n,
            (m, 3).
        normal_component: Lambda_n, (m,).
        tangential: Lambda_t on the first grain (above Eq. 22), (m, 3).
    """

    normal: np.ndarray
    normal_component: np.ndarray
    tangential: np.ndarray

    def __len__(self) -> int:
        return len(self.normal_component)


def vectors_of_contacts(snapshot: Snapshot, volume: np.ndarray | None = None) -> Vectors:
    """Return Vectors with one row per contact, the mean of both sides, so that averages equal those over sides.

    `volume`: see `normalisation`.
    """
    contacts = snapshot.contacts
    weight = 0.5 * normalisation(snapshot, volume).sum(axis=1) / snapshot.young_modulus
    return Vectors(contacts.normal, weight * contacts.normal_force, weight[:, None] * contacts.tangential_force)


def vectors_of_sides(snapshot: Snapshot, side: np.ndarray, weight: np.ndarray) -> Vectors:
    """Return Vectors with one row per selected side; `side` (n, 2) of bool, `weight` (n, 2) = Lambda/f, 1/N."""
    contacts = snapshot.contacts
    row, _ = np.nonzero(side)
    weight = weight[side]
    return Vectors(
        contacts.normal[row], weight * contacts.normal_force[row], weight[:, None] * contacts.tangential_force[row]
    )
