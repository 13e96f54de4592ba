"""Snapshot, the argument of every statistic: grains and contacts at one instant; and Love's stress (Eq. 4)."""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import equivalent_stress, mean_stress, stress_of_forces
from labkit.micro.void_ratio import grain_volume, void_ratio
from labkit.text.html import html_table

if TYPE_CHECKING:
    from labkit.bodies.clumps import Clumps


@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class Contacts:
    """The n physical contacts at one instant, each listed once.

    Args:
        grain: Indices of the first and the second grain, (n, 2), int.
        normal: Unit vector from the first to the second grain, (n, 3).
        overlap: Penetration depth delta, (n,), in m.
        normal_force: Normal force, compression positive, (n,), in N.
        tangential_force: Tangential force on the first grain, (n, 3), in N.
        rolling_moment: Rolling moment on the first grain, (n, 3), in N m.
        vectors: Contact vectors l from the centre of each grain to the contact, (n, 2, 3), in m; None for spheres,
            whose vectors are parallel to the normal.
        columns: Further history variables of the contacts, e.g. of cohesion and bonds: name -> (n,) or (n, 3). Their
            forces are included in normal_force and tangential_force.
    """

    grain: np.ndarray
    normal: np.ndarray
    overlap: np.ndarray
    normal_force: np.ndarray
    tangential_force: np.ndarray
    rolling_moment: np.ndarray
    vectors: np.ndarray | None = None
    columns: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.overlap)

    def __repr__(self) -> str:
        return f"Contacts({len(self)} contacts: {', '.join(vars(self))})"

    def branch_length(self, radius: np.ndarray) -> np.ndarray:
        """Return the distances of grain centres, (n,), in m; R_a + R_b - delta for spheres; `radius` (grain,) in m."""
        if self.vectors is not None:
            return np.linalg.norm(self.branch(radius), axis=1)
        return np.add(*radius.take(self.grain.T)) - self.overlap

    def branch(self, radius: np.ndarray) -> np.ndarray:
        """Return the vector from the first to the second grain centre, (n, 3), in m; `radius` (grain,) in m."""
        if self.vectors is not None:
            return self.vectors[:, 0] - self.vectors[:, 1]
        return self.branch_length(radius)[:, None] * self.normal

    def take(self, rows: np.ndarray) -> Contacts:
        """Return a selection of the contacts; a row may occur several times."""
        chosen = {name: value[rows] for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return Contacts(**chosen, columns={name: value[rows] for name, value in self.columns.items()})

    def force_on_first(self) -> np.ndarray:
        """Return the contact force on the first grain, (n, 3), in N; the force on the second grain is opposite."""
        return self.tangential_force - self.normal_force[:, None] * self.normal


class Law(typing.Protocol):
    """The part of a contact law that the statistics need; implemented by labkit.grains.laws.ContactLaw."""

    def elastic_energy(self, snapshot: Snapshot) -> float:
        """Return the elastic energy of all contact springs (J)."""

    def constraints(self, snapshot: Snapshot) -> np.ndarray:
        """Return the number of relative motions that each contact resists, (n,)."""


class ContactMaterial(typing.Protocol):
    """The part of a scene that statistics and pictures need, in SI units; implemented by labkit.grains.scene.Scene."""

    @property
    def young_modulus(self) -> float:
        """Young's modulus E of the contacts (Pa)."""

    @property
    def density(self) -> float:
        """Grain density rho (kg/m3)."""

    @property
    def friction(self) -> float:
        """Friction coefficient mu of the contacts."""

    @property
    def contact_law(self) -> Law:
        """The contact law."""

    def mass(self, radius: np.ndarray) -> np.ndarray:
        """Return the masses of grains (kg); `radius` in m, any shape."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Snapshot:
    """Grains and contacts at one instant, from a State (`State.snapshot()`) or a run file (`run.lab.snapshot(k)`).

    Args:
        scene: The material of the grains, and the contact law.
        radius: Radii of all grains, including those without contacts, (grain,), in m.
        cell: Cell vectors as columns, (3, 3), in m.
        contacts: The contacts.
        position: Grain centres, not wrapped into the cell, (grain, 3), in m; None if unknown.
        time: Time (s).
        axial_strain: Axial strain since the start of the path; None for a State.
        velocity: Velocities, (grain, 3), in m/s; None for a run file.
        number: Index of the snapshot in its run file.
        members: Snapshot of the spheres, with the same contacts, if the grains are clumps (labkit.bodies).
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
        """Return a table for notebooks."""
        strain = {} if self.axial_strain is None else {"axial strain": f"{self.axial_strain:.2%}"}
        return html_table("Snapshot", strain | summary(self))

    @functools.cached_property
    def volume(self) -> float:
        """Volume of the cell (m3)."""
        return float(np.linalg.det(self.cell))

    @functools.cached_property
    def grain_volume(self) -> float:
        """Total volume of the grains V_g (m3)."""
        return grain_volume(self.radius)

    @functools.cached_property
    def radii(self) -> np.ndarray:
        """Radii of the two grains of each contact, (2, n), in m."""
        return self.radius.take(self.contacts.grain.T)

    @functools.cached_property
    def force_on_first(self) -> np.ndarray:
        """Contact force on the first grain, (n, 3), in N; see Contacts."""
        return self.contacts.force_on_first()

    @property
    def number_of_grains(self) -> int:
        """Number of grains N_g, including those without contacts."""
        return len(self.radius)

    @property
    def young_modulus(self) -> float:
        """Young's modulus E of the contacts (Pa)."""
        return self.scene.young_modulus

    @property
    def spheres(self) -> Snapshot:
        """The Snapshot of the spheres that form the clumps; this Snapshot itself if the grains are spheres."""
        return self if self.members is None else self.members

    def of_spheres(self, values: np.ndarray) -> np.ndarray:
        """Return for each sphere the value of its grain, (sphere, ...), from `values` (grain, ...)."""
        return values if self.clumps is None else values[self.clumps.body]

    def require_position(self) -> np.ndarray:
        """Return the grain centres, shape (grain, 3), in m. Raises InputError if they are unknown."""
        if self.position is None:
            raise InputError("this snapshot has no grain positions: give one of a State, or of a run file with them")
        return self.position

    @functools.cached_property
    def wrapped_position(self) -> np.ndarray:
        """Grain centres wrapped into the cell, whose corner is the origin, shape (grain, 3), in m.

        Raises InputError if the positions are unknown.
        """
        return np.mod(np.linalg.solve(self.cell, self.require_position().T).T, 1.0) @ self.cell.T

    def contact_ends(self) -> np.ndarray:
        """Return the end points of the branch vector of each contact, shape (n, 2, 3), in m.

        The first end point is the centre of the first grain, wrapped into the cell. The second end point lies outside
        the cell if the contact crosses a face of the cell.
        """
        first = self.wrapped_position[self.contacts.grain[:, 0]]
        return np.stack([first, first + self.contacts.branch(self.radius)], axis=1)


OUTWARD = np.array([1.0, -1.0])  # the outward normals of the two sides of a contact are n and -n


def contact_arms(snapshot: Snapshot) -> np.ndarray:
    """Return l.n on each side, with the contact vector l of Eq. 4 and the outward normal n, shape (n, 2), in m.

    For spheres this is the length |l| = R - delta/2. It can be negative for clumps that are not convex.
    """
    contacts = snapshot.contacts
    if contacts.vectors is not None:
        return np.einsum("nsi,ni->ns", contacts.vectors, contacts.normal) * OUTWARD
    return snapshot.radius.take(contacts.grain) - 0.5 * contacts.overlap[:, None]


def contacts_per_grain(snapshot: Snapshot) -> np.ndarray:
    """Return the number of contacts of each grain, shape (grain,)."""
    return np.bincount(snapshot.contacts.grain.ravel(), minlength=snapshot.number_of_grains)


def contact_dyads(snapshot: Snapshot) -> np.ndarray:
    """Return the products l (x) f of the contact vector and the force on each side, (n, 2, 3, 3), in N m."""
    contacts = snapshot.contacts
    force = contacts.force_on_first()
    if contacts.vectors is not None:
        both = np.stack([force, -force], axis=1)
        return contacts.vectors[:, :, :, None] * both[:, :, None, :]
    dyads = contacts.normal[:, :, None] * force[:, None, :]  # equal on both sides: (-n) (x) (-f)
    return contact_arms(snapshot)[:, :, None, None] * dyads[:, None]


def love_stress(snapshot: Snapshot) -> np.ndarray:
    """Return Love's stress sigma = -(1/V) sum of l (x) f over all contact sides, with l = (R - delta/2) n (Eq. 4).

    Both n and f change sign from one side of a contact to the other, so the two terms add up to the dyad of the branch
    vector and the force. The result is (3, 3), in Pa, compression positive; its first index is the index of the branch
    vector. It is zero without contacts.
    """
    contacts = contacts_of(snapshot)
    return stress_of_forces(contacts.branch(snapshot.radius), snapshot.force_on_first, snapshot.volume)


def require_contacts(contacts: Contacts, grains: int) -> None:
    """Raise InputError unless every grain index is below `grains` and all values are valid."""
    index = contacts.grain
    if index.dtype.kind not in "iu" or (index.size and not 0 <= index.min() <= index.max() < grains):
        raise InputError("contact_grain refers to grains that do not exist")
    for name, values in {**vars(contacts), **contacts.columns}.items():
        if isinstance(values, np.ndarray) and not np.isfinite(values).all():
            raise InputError(f"{name} contains values that are not numbers")
    length = np.einsum("ci,ci->c", contacts.normal, contacts.normal)
    if length.size and np.abs(length - 1.0).max() > 1e-5:  # unit vectors in single precision deviate by 1e-7
        raise InputError("normal contains vectors that are not of length one")


NO_CONTACTS = Contacts(
    np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
)


def contacts_of(snapshot: Snapshot) -> Contacts:
    """Return the contacts of a Snapshot. Raises InputError for an object without contacts."""
    contacts: Contacts | None = getattr(snapshot, "contacts", None)
    if contacts is None:
        kind = type(snapshot).__name__
        raise InputError(f"a {kind} is not a Snapshot: give one, such as run.snapshots[-1] or state.snapshot()")
    return contacts


def branch_vectors(position: np.ndarray, cell: np.ndarray, grain: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return the branch vectors x_b + H s - x_a from the first to the second grain, (n, 3), in m.

    Args:
        position: Grain centres, (grain, 3), in m.
        cell: Cell vectors as columns, (3, 3), in m.
        grain: Indices of the two grains, (n, 2).
        shift: Periodic shift of the second grain, in cell vectors, (n, 3).
    """
    return position.take(grain[:, 1], 0) + shift @ cell.T - position.take(grain[:, 0], 0)


def summary(snapshot: Snapshot) -> dict[str, str]:
    """Return the summary of a snapshot, name -> value with its unit, as text."""
    grains, contacts = snapshot.number_of_grains, len(snapshot.contacts)
    stress = love_stress(snapshot) / 1e3
    sides = " x ".join(f"{1e3 * side:.3g}" for side in np.linalg.norm(snapshot.cell, axis=0))
    return {
        "grains": f"{grains:,}",
        "contacts": f"{contacts:,} (Z = {2 * contacts / grains:.2f})",
        "void ratio": f"{void_ratio(snapshot):.4f}",
        "mean stress": f"{mean_stress(stress):.4g} kPa",
        "q (invariant)": f"{equivalent_stress(stress):.4g} kPa",
        "cell": f"{sides} mm",
    }
