"""Tractions on plane cuts through a specimen; their means over parallel planes give Love's stress (section 2)."""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError
from labkit.micro.cells import widths
from labkit.micro.snapshot import Snapshot


def plane_normal(snapshot: Snapshot, axis: int) -> np.ndarray:
    """Return the unit normal (3,) of the two cell faces that the cell vector `axis` connects."""
    row = np.linalg.inv(snapshot.cell)[axis]
    return row / np.linalg.norm(row)


def plane_tractions(snapshot: Snapshot, axis: int, planes: int) -> np.ndarray:
    """Return the tractions on equally spaced planes parallel to a face of the cell, (planes, 3), in Pa.

    The traction on a plane is the sum of the forces of all contacts whose branches cross the plane, divided by the area
    of the plane. Each force is the force on the grain on the side of the normal n, compression positive; a contact
    that crosses the plane several times adds its force each time. The mean traction over all planes is n . sigma, with
    Love's stress sigma (first index: branch), because a branch b crosses a fraction n . b/h of the planes in a cell of
    height h. Raises InputError unless `axis`, the cell vector that the planes cut, is 0, 1 or 2 and `planes` is
    positive.
    """
    if axis not in (0, 1, 2):
        raise InputError("is not a cell vector", field="axis", value=axis, allowed="0, 1 or 2")
    if planes < 1:
        raise InputError("is not a number of planes", field="planes", value=planes, allowed="1 or more")
    row = np.linalg.inv(snapshot.cell)[axis]
    ends = np.sort(snapshot.contact_ends() @ row, axis=1)  # heights divided by the height of the cell
    force = -snapshot.contacts.force_on_first()
    across = snapshot.contacts.normal @ row > 0.0
    force = np.where(across[:, None], force, -force)
    lowest = np.ceil(ends[:, 0] * planes - 0.5).astype(int)  # plane k lies at the height (k + 1/2)/planes
    crossed = np.floor(ends[:, 1] * planes - 0.5).astype(int) - lowest + 1
    contact = np.repeat(np.arange(len(force)), crossed)
    first = np.cumsum(crossed) - crossed
    plane = np.mod(lowest[contact] + np.arange(len(contact)) - first[contact], planes)
    sums = np.stack([np.bincount(plane, force[contact, k], planes) for k in range(3)], axis=1)
    return sums * widths(snapshot.cell)[axis] / snapshot.volume
