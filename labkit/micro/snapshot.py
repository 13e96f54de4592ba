"""Snapshot: grains and contacts at one instant, the argument of every statistic."""

from __future__ import annotations

import dataclasses
import functools
import typing
from typing import TYPE_CHECKING

import numpy as np

from labkit.io.html import html_table
from labkit.micro.contacts import Contacts
from labkit.micro.summary import summary

if TYPE_CHECKING:
    from labkit.micro.clumps import Clumps


class Law(typing.Protocol):
    """Part of a contact law that the statistics need; implemented by labkit.grains.laws.ContactLaw."""

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Elastic energy of all contact springs, J."""


class ContactMaterial(typing.Protocol):
    """Part of a scene that the statistics and pictures need, in SI units; implemented by labkit.grains.scene.Scene."""

    @property
    def young_modulus(self) -> float:
        """Young's modulus E of the contacts, Pa."""

    @property
    def density(self) -> float:
        """Grain density rho, kg/m3."""

    @property
    def friction(self) -> float:
        """Friction coefficient mu of the contacts."""

    @property
    def contact_law(self) -> Law:
        """The contact law."""

    def mass(self, radius: np.ndarray) -> np.ndarray:
        """Mass of grains, kg. `radius` in m, any shape."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Snapshot:
    """Grains and contacts at one instant, from a State (`State.snapshot()`) or a run file (`run.lab.snapshot(k)`).

    Args:
        scene: The material.
        radius: Radii of all grains, including those without contacts, (grain,), m.
        cell: Cell vectors as columns, (3, 3), m.
        contacts: The contacts.
        position: Grain centres, not wrapped into the cell, (grain, 3), m; None if unknown.
        time: Time, s.
        axial_strain: Axial strain since the start of the path; None for a State.
        velocity: Velocities, (grain, 3), m/s; None for a run file.
        number: Index of the snapshot in its run file.
        members: Snapshot of the spheres, with the same contacts, if the grains are clumps (labkit.micro.clumps).
        clumps: The clumps; None for spheres.
    """

    scene: ContactMaterial
    radius: np.ndarray
    cell: np.ndarray
    contacts: Contacts
    position: np.ndarray | None = None
    time: float = 0.0
    axial_strain: float | None = None
    velocity: np.ndarray | None = None
    number: int = 0
    members: Snapshot | None = None
    clumps: Clumps | None = None

    def __repr__(self) -> str:
        strain = "" if self.axial_strain is None else f", axial strain {self.axial_strain:.2%}"
        return f"Snapshot({self.number_of_grains} grains, {len(self.contacts)} contacts{strain})"

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        strain = {} if self.axial_strain is None else {"axial strain": f"{self.axial_strain:.2%}"}
        return html_table("Snapshot", strain | summary(self))

    @functools.cached_property
    def volume(self) -> float:
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    @property
    def number_of_grains(self) -> int:
        """Number of grains N_g, including those without contacts."""
        return len(self.radius)

    @property
    def young_modulus(self) -> float:
        """Young's modulus E of the contacts, Pa."""
        return self.scene.young_modulus

    @property
    def spheres(self) -> Snapshot:
        """The Snapshot of the spheres: that of the members of clumps, or this one."""
        return self if self.members is None else self.members

    @functools.cached_property
    def wrapped_position(self) -> np.ndarray:
        """Grain centres wrapped into the cell, whose corner is the origin, shape (grain, 3), m.

        Raises ValueError if the positions are unknown.
        """
        if self.position is None:
            raise ValueError("this snapshot has no grain positions")
        return np.mod(np.linalg.solve(self.cell, self.position.T).T, 1.0) @ self.cell.T

    def contact_ends(self) -> np.ndarray:
        """End points of the branch vector of each contact, shape (n, 2, 3), m.

        The first is the centre of the first grain, wrapped into the cell; the second lies outside the cell if the
        contact crosses a face of the cell.
        """
        first = self.wrapped_position[self.contacts.grain[:, 0]]
        return np.stack([first, first + self.contacts.branch(self.radius)], axis=1)


def contact_arms(snapshot: Snapshot) -> np.ndarray:
    """Length |l| of the contact vector l on each side (Eq. 4), R - delta/2 of spheres, shape (n, 2), m."""
    contacts = snapshot.contacts
    if contacts.vectors is not None:
        return np.linalg.norm(contacts.vectors, axis=2)
    return snapshot.radius[contacts.grain] - 0.5 * contacts.overlap[:, None]


def contacts_per_grain(snapshot: Snapshot) -> np.ndarray:
    """Number of contacts of each grain, shape (grain,)."""
    return np.bincount(snapshot.contacts.grain.ravel(), minlength=snapshot.number_of_grains)


def contact_dyads(snapshot: Snapshot) -> np.ndarray:
    """Products l (x) f of the contact vector and the force on each side, (n, 2, 3, 3), N m."""
    contacts = snapshot.contacts
    force = contacts.force_on_first()
    if contacts.vectors is not None:
        both = np.stack([force, -force], axis=1)
        return contacts.vectors[:, :, :, None] * both[:, :, None, :]
    dyads = contacts.normal[:, :, None] * force[:, None, :]  # equal on both sides: (-n) (x) (-f)
    return contact_arms(snapshot)[:, :, None, None] * dyads[:, None]
