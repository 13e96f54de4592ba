"""Rigid clumps of spheres: which grains form a body, its geometry and motion, and the Snapshot of the bodies.

A State lists the spheres of all clumps as its grains. Every statistic is a function of a Snapshot of the bodies: a
grain is then a clump, its radius that of a sphere of equal volume, and the contact vectors of its contacts start at its
centre of mass, so that they are not parallel to the normals. Two bodies may touch in several contacts.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from labkit.micro.snapshot import Snapshot, contact_arms, contacts_of, love_stress
from labkit.micro.stress import stress_of


@dataclasses.dataclass(frozen=True, eq=False)
class Clumps:
    """Bodies of one or more spheres; labkit.io.schema.CLUMPS lists shapes and units.

    The spheres of a body are consecutive. The axes of a body are its principal axes, in ascending order of their
    moments: the first one is its long axis.
    """

    body: np.ndarray
    arm: np.ndarray
    body_volume: np.ndarray
    body_inertia: np.ndarray
    body_position: np.ndarray
    body_velocity: np.ndarray
    orientation: np.ndarray
    angular_momentum: np.ndarray

    @functools.cached_property
    def first(self) -> np.ndarray:
        """First sphere of each body, (body,)."""
        return np.searchsorted(self.body, np.arange(len(self.body_volume)))

    @functools.cached_property
    def single(self) -> np.ndarray:
        """True for the bodies of one sphere, (body,); they are grains like any other."""
        return np.bincount(self.body, minlength=len(self.body_volume)) == 1

    def equivalent_radius(self, radius: np.ndarray) -> np.ndarray:
        """Radius of a sphere with the volume of each body, (body,), m; `radius` (grain,) of the spheres in m."""
        return np.where(self.single, radius[self.first], np.cbrt(0.75 / np.pi * self.body_volume))

    def at_rest(self) -> Clumps:
        """Return a copy without motion."""
        zero = np.zeros_like(self.body_velocity)
        return dataclasses.replace(self, body_velocity=zero, angular_momentum=zero)

    def after(
        self,
        density: float,
        position: np.ndarray,
        velocity: np.ndarray,
        spin: np.ndarray,
        clumps: Sequence[np.ndarray] | None = None,
    ) -> Clumps:
        """Return the clumps after a motion.

        Args:
            density: Of the grains, kg/m3.
            position: Of all spheres, (grain, 3), m.
            velocity: Of all spheres, (grain, 3), m/s.
            spin: Of all spheres, (grain, 3), rad/s.
            clumps: Position, velocity, orientation and angular momentum of the bodies of two or more spheres.
        """
        first, inertia = self.first, density * self.body_inertia
        own = position[first], velocity[first], self.orientation.copy(), inertia * spin[first]
        for values, changed in zip(own, clumps or own, strict=True):
            values[~self.single] = changed if clumps else values[~self.single]
        names = "body_position", "body_velocity", "orientation", "angular_momentum"
        return dataclasses.replace(self, **dict(zip(names, own, strict=True)))

    def axes(self) -> np.ndarray:
        """Principal axes of each body as columns, (body, 3, 3)."""
        return rotation(self.orientation)


def clumps_at_rest(body: np.ndarray, **values: np.ndarray) -> Clumps:
    """Return Clumps without motion from the variables of a run file; values: those besides `body`."""
    zero = np.zeros_like(values["body_position"], dtype=float)
    doubles = {name: value.astype(float) for name, value in values.items()}
    return Clumps(body, **doubles, body_velocity=zero, angular_momentum=zero)


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4) with the real part first."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def snapshot_of_bodies(spheres: Snapshot, clumps: Clumps) -> Snapshot:
    """Return the Snapshot of the bodies that the grains of a Snapshot form; the same one if all are single spheres."""
    if clumps.single.all():
        return spheres
    if spheres.position is None:
        raise ValueError("this snapshot has no grain positions")
    contacts, grain = spheres.contacts, spheres.contacts.grain
    arm = spheres.position - clumps.body_position[clumps.body]
    reach = contact_arms(spheres)[:, :, None] * contacts.normal[:, None]
    vectors = arm[grain] + reach * np.array([1.0, -1.0])[:, None]
    return dataclasses.replace(
        spheres,
        radius=clumps.equivalent_radius(spheres.radius),
        contacts=dataclasses.replace(contacts, grain=clumps.body[grain], vectors=vectors),
        position=clumps.body_position,
        velocity=None if spheres.velocity is None else clumps.body_velocity,
        members=spheres,
        clumps=clumps,
    )


def branch_anisotropy(snapshot: Snapshot) -> np.ndarray:
    """Anisotropy 15/2 (<b b> - I/3) of the directions b of the branches, (3, 3); NaN without contacts.

    A branch leads from centre to centre; for spheres, it is parallel to the contact normal, and the result is A.
    """
    branch = contacts_of(snapshot).branch(snapshot.radius)
    return _anisotropy(branch / np.linalg.norm(branch, axis=1, keepdims=True))


def axis_anisotropy(snapshot: Snapshot) -> np.ndarray:
    """Anisotropy 15/2 (<a a> - I/3) of the long axes a of the bodies, (3, 3); NaN for spheres."""
    return np.full((3, 3), np.nan) if snapshot.clumps is None else _anisotropy(snapshot.clumps.axes()[:, :, 0])


def stress_along_normals(snapshot: Snapshot) -> np.ndarray:
    """Love's stress (3, 3), Pa, if the contact vectors kept their length |l| but were parallel to the normals.

    C0 assumes this. For spheres it is Love's stress.
    """
    contacts = contacts_of(snapshot)
    if contacts.vectors is None:
        return love_stress(snapshot)
    length = contact_arms(snapshot).sum(axis=1)
    return stress_of(length[:, None] * contacts.normal, contacts.force_on_first(), snapshot.volume)


def contacts_per_pair(snapshot: Snapshot) -> float:
    """Mean number of contacts of two touching bodies, 1 for convex ones; NaN without contacts."""
    grain, contacts = contacts_of(snapshot).grain, snapshot.contacts
    branch = np.round(contacts.branch(snapshot.radius) / (1e-6 * snapshot.radius.mean()))  # tells images apart
    first = np.where((grain[:, 0] < grain[:, 1])[:, None], branch, -branch)
    pairs = np.unique(np.column_stack([np.sort(grain, axis=1), first]), axis=0)
    return len(grain) / len(pairs) if len(grain) else np.nan


def _anisotropy(direction):
    if not len(direction):
        return np.full((3, 3), np.nan)
    return 7.5 * (direction.T @ direction / len(direction) - np.eye(3) / 3.0)
