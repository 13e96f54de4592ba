"""Snapshot: grains and contacts at one instant, the one argument of every statistic."""

from __future__ import annotations

import dataclasses
import functools
import typing

import numpy as np

from labkit.micro.contacts import Contacts


class Law(typing.Protocol):
    """What the statistics need of a contact law; labkit.dem.laws.ContactLaw has it."""

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Energy of all contact springs, J."""


class Material(typing.Protocol):
    """What the statistics and the pictures need of a scene; labkit.dem.scene.Scene has it. SI units."""

    @property
    def young_modulus(self) -> float:
        """E, Pa."""

    @property
    def density(self) -> float:
        """rho, kg/m3."""

    @property
    def friction(self) -> float:
        """mu of the contacts."""

    @property
    def contact_law(self) -> Law:
        """The law between forces and overlaps."""

    def mass(self, radius: np.ndarray) -> np.ndarray:
        """Mass of grains, kg. `radius` in m, any shape."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Snapshot:
    """Grains and contacts at one instant, of a State (`State.snapshot()`) or of a run file (`run.lab.snapshot(k)`).

    scene: the material; radius (grain,), m: of all grains, those without contacts included; cell (3, 3), m: cell
    vectors as columns; contacts; position (grain, 3), m: of the centres, not wrapped into the cell, None if not
    known; time, s; axial_strain since the start of the path, None for a state; velocity (grain, 3), m/s, None for a
    run file; number: of the snapshot in its run file.
    """

    scene: Material
    radius: np.ndarray
    cell: np.ndarray
    contacts: Contacts
    position: np.ndarray | None = None
    time: float = 0.0
    axial_strain: float | None = None
    velocity: np.ndarray | None = None
    number: int = 0

    def __repr__(self) -> str:
        strain = "" if self.axial_strain is None else f", axial strain {self.axial_strain:.2%}"
        return f"Snapshot({self.number_of_grains} grains, {len(self.contacts)} contacts{strain})"

    @functools.cached_property
    def volume(self) -> float:
        """Volume of the cell, m3."""
        return float(np.linalg.det(self.cell))

    @property
    def number_of_grains(self) -> int:
        """N_g, grains without contacts included."""
        return len(self.radius)

    @property
    def young_modulus(self) -> float:
        """E of the grains, Pa."""
        return self.scene.young_modulus

    @functools.cached_property
    def wrapped_position(self) -> np.ndarray:
        """Centres moved by cell periods into the cell, which begins at the origin, shape (grain, 3), m."""
        return np.mod(np.linalg.solve(self.cell, self.position.T).T, 1.0) @ self.cell.T

    def contact_ends(self) -> np.ndarray:
        """Both ends of each contact, shape (n, 2, 3), m: the first centre, in the cell, and from there along the branch
        to the second, which lies beyond the face of the cell if the contact goes through it.
        """
        first = self.wrapped_position[self.contacts.grain[:, 0]]
        branch = self.contacts.branch_length(self.radius)[:, None] * self.contacts.normal
        return np.stack([first, first + branch], axis=1)


def contact_arms(snapshot: Snapshot) -> np.ndarray:
    """|l| = R - delta/2 of the contact vector l on each side (Eq. 4), shape (n, 2), m."""
    contacts = snapshot.contacts
    return snapshot.radius[contacts.grain] - 0.5 * contacts.overlap[:, None]


def contacts_per_grain(snapshot: Snapshot) -> np.ndarray:
    """Number of contacts of each grain, shape (grain,)."""
    return np.bincount(snapshot.contacts.grain.ravel(), minlength=snapshot.number_of_grains)
