"""Contact points in a contact list, which give the contact vectors of grains of any shape."""

from __future__ import annotations

from typing import cast

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.pairs import nearest_shift

STRAIGHT = 1e-3  # largest sine of the angle between the two contact vectors of spheres, which are opposite
MOST = 0.99  # fraction of the contacts of spheres for which this holds, because files round numbers


def contact_vectors(contacts: ContactList, position: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vectors (n, 2, 3) from the centres of the two grains to the contact, and the shift (n, 3) of the second.

    Args:
        contacts: Contacts with points, in the frame of the grain centres, and with numbers of grains.
        position: Grain centres, (grain, 3), in the unit of the contact points.
        cell: Cell vectors as columns, (3, 3).
    """
    point, grain = cast(np.ndarray, contacts.point), contacts.grain
    places, number = np.concatenate([position, point]), len(position) + np.arange(len(point))
    shift = np.stack([nearest_shift(places, cell, np.stack([side, number], axis=1)) for side in grain.T], axis=1)
    return point[:, None] + shift @ cell.T - position[grain], shift[:, 0] - shift[:, 1]


def of_spheres(vectors: np.ndarray) -> bool:
    """True if the two contact vectors of nearly all contacts, (n, 2, 3), are parallel, as those of spheres are."""
    first, second = vectors[:, 0], vectors[:, 1]
    size = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    straight = np.linalg.norm(np.cross(first, second), axis=1) <= STRAIGHT * size
    return bool(straight.mean() >= MOST) if len(straight) else True


def contact_normals(contacts: ContactList, vectors: np.ndarray) -> np.ndarray:
    """Return unit normals from the first to the second grain, (n, 3); without a direction, that of the branch.

    Raises InputError if the list has no normals or no forces.
    """
    if contacts.normal is None or not contacts.has_forces:
        missing = "normals (nx,ny,nz) or normal forces as vectors" if contacts.has_forces else "contact forces"
        raise InputError(f"the contact list has points, but no {missing}: name their columns with --contact-columns")
    branch = vectors[:, 0] - vectors[:, 1]
    along = np.where(contacts.normal.any(axis=1, keepdims=True), contacts.normal, branch)
    along = along * np.where(np.einsum("ci,ci->c", along, branch) < 0.0, -1.0, 1.0)[:, None]
    return along / np.linalg.norm(along, axis=1, keepdims=True)
