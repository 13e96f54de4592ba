"""ContactList: the contacts that a file of another program lists, in the units of the file.

Contact points in the list give the contact vectors of grains of any shape.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import cast

import numpy as np

from labkit.errors import InputError
from labkit.plugins.exchange.pairs import nearest_shift


@dataclasses.dataclass(frozen=True, eq=False)
class ContactList:
    """Contacts as listed in a file, in the units of the file. A field is None if the file does not specify it.

    The forces are either `normal_force` and `tangential_force`, or `force`.

    Args:
        grain: Ids of the two grains, (n, 2).
        normal_force: Normal force, (n,).
        positive: Meaning of a positive normal force, "compression" or "tension".
        force: Whole contact force, (n, 3).
        tangential_force: Tangential force, (n, 3).
        acts_on: Grain on which the vectors act, "first" or "second".
        overlap: Overlap, (n,), which is only compared with the overlap of the grains.
        overlap_unit: Unit of the overlap, m; None if it is the same as in the file of grains.
        point: Contact points, (n, 3), in the frame of the grain centres; then the grains may have any shape.
        point_unit: Unit of the contact points, m; None if it is the same as in the file of grains.
        normal: Vectors along the contact normals, (n, 3), of any length and sign; used with contact points.
        force_unit: Unit of force, N; None if it is the same as in the file of grains.
        at: Instant of the contacts, `step` or `time` -> number.
        notes: What the reader of the file omitted or assumed.
    """

    grain: np.ndarray
    normal_force: np.ndarray | None = None
    positive: str | None = None
    tangential_force: np.ndarray | None = None
    force: np.ndarray | None = None
    acts_on: str | None = None
    overlap: np.ndarray | None = None
    overlap_unit: float | None = None
    point: np.ndarray | None = None
    point_unit: float | None = None
    normal: np.ndarray | None = None
    force_unit: float | None = None
    at: Mapping[str, float] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.grain)

    def rows(self, index: np.ndarray) -> ContactList:
        """Return the contacts with these numbers, or those for which a mask is true."""
        arrays = {name: values[index] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return dataclasses.replace(self, **arrays)

    @property
    def has_forces(self) -> bool:
        """True if the list contains normal forces or force vectors."""
        return self.normal_force is not None or self.force is not None


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
