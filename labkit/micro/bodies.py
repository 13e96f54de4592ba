"""The Snapshot of bodies, and the statistics that only bodies have.

Every statistic is a function of a Snapshot of the bodies: each grain is then a clump, and `radius` is the radius of a
sphere of equal volume. The contact vectors start at the centre of mass of the clump, so they are not parallel to the
normals. Two bodies may touch in several contacts.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.micro.branches import anisotropy_of
from labkit.micro.snapshot import OUTWARD, Snapshot, contact_arms


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
