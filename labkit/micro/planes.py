"""Tractions on plane cuts through a specimen; their means over parallel planes give Love's stress (section 2).

Also bins of directions with equal solid angle, and means over them.
"""

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


def polar_bins(n: np.ndarray, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Divide directions n (m, 3) into bins of equal solid angle about z.

    n and -n are treated as the same direction: the angle from z runs from 0 to 90 degrees. Returns the cosines
    of the edges (bins + 1,) and the bin of each row (m,).
    """
    edges = np.linspace(0.0, 1.0, bins + 1)
    return edges, np.clip((np.abs(n[:, 2]) * bins).astype(int), 0, bins - 1)


def bin_means(values: np.ndarray, bin_of: np.ndarray, bins: int) -> np.ndarray:
    """Return the mean of `values` (m,) in each bin `bin_of` (m,), shape (bins,); NaN for empty bins."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.bincount(bin_of, values, bins) / np.bincount(bin_of, minlength=bins)


def hemisphere_bins(n: np.ndarray, bands: int, sectors: int) -> np.ndarray:
    """Divide the hemisphere z > 0 into bins of equal solid angle; return the bin of each row, band * sectors + sector.

    Directions `n` (m, 3) with z < 0 are reflected. The bands have equal heights in z, the sectors equal azimuths.
    """
    up = np.where(n[:, 2:] < 0.0, -n, n)
    band = np.clip((up[:, 2] * bands).astype(int), 0, bands - 1)
    azimuth = np.mod(np.arctan2(up[:, 1], up[:, 0]), 2.0 * np.pi)
    return band * sectors + np.clip((azimuth / (2.0 * np.pi) * sectors).astype(int), 0, sectors - 1)
