"""The Snapshot of bodies, and the statistics that only bodies have.

Every statistic is a function of a Snapshot of the bodies: each grain is then a clump, and `radius` is the radius of a
sphere of equal volume. The contact vectors start at the centre of mass of the clump, so they are not parallel to the
normals. Two bodies may touch in several contacts.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.micro.snapshot import OUTWARD, Snapshot, contact_arms, contacts_of, love_stress
from labkit.micro.stress import stress_of_forces


def anisotropy_of(direction: np.ndarray) -> np.ndarray:
    """Return the anisotropy 15/2 (<d d> - I/3) of directions d (n, 3), shape (3, 3); NaN for n = 0."""
    if not len(direction):
        return np.full((3, 3), np.nan)
    return 7.5 * (direction.T @ direction / len(direction) - np.eye(3) / 3.0)


def branch_anisotropy(snapshot: Snapshot) -> np.ndarray:
    """Return the anisotropy 15/2 (<b b> - I/3) of the directions b of the branches, (3, 3); NaN without contacts.

    A branch joins two grain centres. For spheres it is parallel to the contact normal, and the result is A.
    """
    branch = contacts_of(snapshot).branch(snapshot.radius)
    return anisotropy_of(branch / np.linalg.norm(branch, axis=1, keepdims=True))


def stress_along_normals(snapshot: Snapshot) -> np.ndarray:
    """Return Love's stress (3, 3), in Pa, from only the normal parts (l.n) n of the contact vectors.

    The remainder consists of M and X (labkit.micro.eccentricity). For spheres the result is Love's stress itself.
    """
    contacts = contacts_of(snapshot)
    if contacts.vectors is None:
        return love_stress(snapshot)
    length = contact_arms(snapshot).sum(axis=1)
    return stress_of_forces(length[:, None] * contacts.normal, contacts.force_on_first(), snapshot.volume)


def contacts_per_pair(snapshot: Snapshot) -> float:
    """Return the mean number of contacts between two touching grains: 1 for convex grains, NaN without contacts."""
    grain, contacts = contacts_of(snapshot).grain, snapshot.contacts
    branch = np.round(contacts.branch(snapshot.radius) / (1e-6 * snapshot.radius.mean()))  # tells periodic images apart
    first = np.where((grain[:, 0] < grain[:, 1])[:, None], branch, -branch)
    pairs = np.unique(np.column_stack([np.sort(grain, axis=1), first]), axis=0)
    return len(grain) / len(pairs) if len(grain) else np.nan


def snapshot_of_bodies(spheres: Snapshot, bodies: Clumps | None) -> Snapshot:
    """Return the Snapshot of the bodies that spheres form; `spheres` itself if every body is a single sphere."""
    if bodies is None or bodies.single.all():
        return spheres
    contacts, grain = spheres.contacts, spheres.contacts.grain
    arm = spheres.require_position() - bodies.body_position[bodies.body]
    reach = contact_arms(spheres)[:, :, None] * contacts.normal[:, None]
    vectors = arm[grain] + reach * OUTWARD[:, None]
    return dataclasses.replace(
        spheres,
        radius=bodies.equivalent_radius(spheres.radius),
        contacts=dataclasses.replace(contacts, grain=bodies.body[grain], vectors=vectors),
        position=bodies.body_position,
        velocity=None if spheres.velocity is None else bodies.body_velocity,
        members=spheres,
        clumps=bodies,
    )


def long_axes(snapshot: Snapshot) -> np.ndarray | None:
    """Return the directions of the long axes of the bodies, (grain, 3); None for spheres."""
    return None if snapshot.clumps is None else snapshot.clumps.axes()[:, :, 0]


def axis_anisotropy(snapshot: Snapshot) -> np.ndarray:
    """Return the anisotropy 15/2 (<a a> - I/3) of the long axes a of the bodies, (3, 3); NaN for spheres."""
    axes = long_axes(snapshot)
    return np.full((3, 3), np.nan) if axes is None else anisotropy_of(axes)
