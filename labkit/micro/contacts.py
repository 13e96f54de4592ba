"""Contacts at one instant: their geometry and forces, the input of every statistic."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from labkit.errors import InputError
from labkit.io.links import BOND_FORCE

if TYPE_CHECKING:
    from labkit.micro.snapshot import Snapshot


@dataclasses.dataclass(frozen=True, repr=False)
class Contacts:
    """The n physical contacts at one instant, each listed once.

    Args:
        grain: Indices of the first and the second grain, (n, 2), int.
        normal: Unit vector from the first to the second grain, (n, 3).
        overlap: Penetration depth delta, (n,), m.
        normal_force: Normal force, compression positive, (n,), N.
        tangential_force: Tangential force on the first grain, (n, 3), N.
        rolling_moment: Rolling moment on the first grain, (n, 3), N m.
        vectors: Contact vectors l from the centre of each grain to the contact, (n, 2, 3), m; None for spheres, whose
            vectors are parallel to the normal.
        links: Links of cohesion and bonds (labkit.io.links), (n, 8); None if the scene has none. The normal and the
            tangential force include theirs.
    """

    grain: np.ndarray
    normal: np.ndarray
    overlap: np.ndarray
    normal_force: np.ndarray
    tangential_force: np.ndarray
    rolling_moment: np.ndarray
    vectors: np.ndarray | None = None
    links: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.overlap)

    def __repr__(self) -> str:
        return f"Contacts({len(self)} contacts: {', '.join(vars(self))})"

    def branch_length(self, radius: np.ndarray) -> np.ndarray:
        """Distance between the two grain centres, (n,), m, R_a + R_b - delta of spheres; `radius` (grain,) in m."""
        if self.vectors is not None:
            return np.linalg.norm(self.branch(radius), axis=1)
        return radius[self.grain[:, 0]] + radius[self.grain[:, 1]] - self.overlap

    def branch(self, radius: np.ndarray) -> np.ndarray:
        """Vector from the first to the second grain centre, (n, 3), m; `radius` (grain,) in m."""
        if self.vectors is not None:
            return self.vectors[:, 0] - self.vectors[:, 1]
        return self.branch_length(radius)[:, None] * self.normal

    def take(self, rows: np.ndarray) -> Contacts:
        """Return a selection of the contacts; a row may occur several times."""
        kept = {name: value[rows] for name, value in vars(self).items() if value is not None}
        return Contacts(**kept)

    def friction_force(self) -> np.ndarray:
        """Tangential force on the first grain without that of bonds, shape (n, 3), N."""
        return self.tangential_force if self.links is None else self.tangential_force - self.links[:, BOND_FORCE]

    def force_on_first(self) -> np.ndarray:
        """Contact force on the first grain, shape (n, 3), N; the force on the second is opposite."""
        return self.tangential_force - self.normal_force[:, None] * self.normal


def require_contacts(contacts: Contacts, grains: int) -> None:
    """Raise ValueError unless every grain index is below `grains` and all values are valid."""
    index = contacts.grain
    if index.dtype.kind not in "iu" or (index.size and not 0 <= index.min() <= index.max() < grains):
        raise ValueError("contact_grain refers to grains that do not exist")
    for field in dataclasses.fields(contacts):
        values = getattr(contacts, field.name)
        if values is not None and not np.isfinite(values).all():
            raise ValueError(f"{field.name} contains values that are not numbers")
    length = np.einsum("ci,ci->c", contacts.normal, contacts.normal)
    if length.size and np.abs(length - 1.0).max() > 1e-5:  # 1e-7 in single precision
        raise ValueError("normal contains vectors that are not of length one")


NO_CONTACTS = Contacts(
    np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
)


def contacts_of(snapshot: Snapshot) -> Contacts:
    """Return the contacts of a Snapshot. Raises InputError for a value of another type."""
    contacts: Contacts | None = getattr(snapshot, "contacts", None)
    if contacts is None:
        kind = type(snapshot).__name__
        raise InputError(f"a {kind} is not a Snapshot: give one, such as run.snapshots[-1] or state.snapshot()")
    return contacts


def branch_vectors(position: np.ndarray, cell: np.ndarray, grain: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Branch vectors x_b + H s - x_a from the first to the second grain, (n, 3), m.

    Args:
        position: Grain centres, (grain, 3), m.
        cell: Cell vectors as columns, (3, 3), m.
        grain: Indices of the two grains, (n, 2).
        shift: Periodic shift of the second grain, in cell vectors, (n, 3).
    """
    return position[grain[:, 1]] + shift @ cell.T - position[grain[:, 0]]
