"""The normalised contact force f~ of Eqs. 18-22, on both sides of every contact.

A contact has two sides, one on each grain. The magnitude of the force is the same on both sides. The magnitude of the
normalised force differs if the grains differ in size.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.eccentricity import eccentric_dyads
from labkit.micro.snapshot import Snapshot, contact_arms


def normalisation(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Return the factor f~/f = l.n/v, for spheres 3 lambda'/(pi D^2), of each side (below Eq. 18), (n, 2), in 1/m2.

    In a planar layer, grains are discs: with v = pi D^2/4 times the thickness of the layer,
    f~/f = 2 lambda'/(pi D thickness).

    Args:
        snapshot: The snapshot.
        volume: Volume v of each grain, (grain,), m3 (default: the volume of the sphere).
    """
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3 if volume is None else volume
    return contact_arms(snapshot) / volume.take(snapshot.contacts.grain)


def mean_volume(snapshot: Snapshot) -> np.ndarray:
    """Return the mean grain volume V_g/N_g, repeated for every grain, shape (grain,), in m3."""
    return np.full(snapshot.number_of_grains, (4.0 / 3.0 * np.pi * snapshot.radius**3).mean())


def normalised_force(snapshot: Snapshot) -> np.ndarray:
    """Return the normalised force f~ = 3 lambda' f/(pi D^2) on each side (below Eq. 18), shape (n, 2, 3), in Pa.

    f is the force on the grain that owns the side; the forces on the two sides are opposite.
    """
    force = snapshot.contacts.force_on_first()
    both = np.stack([force, -force], axis=1)
    return normalisation(snapshot)[:, :, None] * both


def normalised_normal_force(snapshot: Snapshot, volume: np.ndarray | None = None) -> np.ndarray:
    """Return Lambda_n = 3 lambda' f_n/(pi D^2 E) of each side (Eq. 22), shape (n, 2). `volume`: see `normalisation`."""
    return normalisation(snapshot, volume) * (snapshot.contacts.normal_force / snapshot.young_modulus)[:, None]


@dataclasses.dataclass(frozen=True, eq=False)
class Vectors:
    """Normalised forces that C0 and related equations average. A row is a contact side, or the mean of both sides.

    Args:
        normal: n, (m, 3), from the first to the second grain on both sides, because n n and n (x) Lambda are even
            in n.
        normal_component: Lambda_n, (m,).
        tangential: Lambda_t on the first grain (above Eq. 22), (m, 3).
        eccentric: The terms of eccentric contacts (labkit.micro.eccentricity.eccentric_dyads), (2, m, 3, 3); None for
            spheres.
    """

    normal: np.ndarray
    normal_component: np.ndarray
    tangential: np.ndarray
    eccentric: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.normal_component)


def vectors_of_contacts(snapshot: Snapshot, volume: np.ndarray | None = None) -> Vectors:
    """Return Vectors with one row per contact, the mean of its two sides.

    Averages over contacts then equal averages over sides. `volume`: see `normalisation`.
    """
    contacts = snapshot.contacts
    weight = 0.5 * np.add(*normalisation(snapshot, volume).T) / snapshot.young_modulus
    eccentric = None if contacts.vectors is None else eccentric_dyads(snapshot, volume).mean(axis=2)
    return Vectors(
        contacts.normal, weight * contacts.normal_force, weight[:, None] * contacts.tangential_force, eccentric
    )


def vectors_of_sides(snapshot: Snapshot, side: np.ndarray, volume: np.ndarray) -> Vectors:
    """Return Vectors with one row per selected side; `side` (n, 2) of bool, `volume`: see `normalisation`."""
    contacts = snapshot.contacts
    row, _ = np.nonzero(side)
    weight = (contact_arms(snapshot) / (volume.take(contacts.grain) * snapshot.young_modulus))[side]
    eccentric = None if contacts.vectors is None else eccentric_dyads(snapshot, volume)[:, side]
    force, tangential = contacts.normal_force[row], contacts.tangential_force[row]
    return Vectors(contacts.normal[row], weight * force, weight[:, None] * tangential, eccentric)
