"""Clumps in files of other programs: spheres that the file groups become the bodies of a State."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from labkit.bodies.clumps import Clumps
from labkit.bodies.shapes import principal_moments
from labkit.micro.cells import widths
from labkit.plugins.exchange.packing import Packing
from labkit.plugins.exchange.pairs import overlapping_pairs

COLUMNS = 200  # integration columns along a side of a clump, for an error of 1e-4
NEAR = 1e-3  # gap over radii up to which two spheres of a clump are treated as touching
WIDEST = 0.5  # largest size of a clump over the width of the box


def with_clumps(packing: Packing) -> tuple[Packing, Clumps | None]:
    """Return a packing in SI units, sorted so that the spheres of a clump are consecutive, and its clumps or None.

    If the spheres of a group do not touch or extend over more than half of the box, they stay separate, with a note.
    """
    position, radius, cell = packing.position, packing.size, packing.cell
    assert radius is not None and cell is not None
    if packing.body is None:
        return packing, None
    bodies, position, lost = _connected(packing.body, position, radius, cell)
    if lost:
        packing = packing.with_notes(
            f"{lost} groups of spheres are no clumps, which must touch and fit into half the box"
        )
    groups = int((bodies != np.arange(len(bodies))).sum())
    if not groups:
        return packing, None
    order = np.argsort(bodies, kind="stable")
    body = np.unique(bodies[order], return_inverse=True)[1].astype(np.int32)
    count = np.bincount(body)
    several = f"{int((count > 1).sum())} clumps of {int(count[count > 1].sum())} spheres are kept"
    packing = dataclasses.replace(
        packing.with_notes(several),
        position=position[order],
        size=radius[order],
        id=None if packing.id is None else packing.id[order],
    )
    return packing, _bodies(body, position[order], radius[order])


def pairs_between(
    clumps: Clumps | None, grain: np.ndarray, shift: np.ndarray, overlap: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the pairs of overlapping grains (see `overlapping_pairs`) that do not belong to the same clump."""
    if clumps is None:
        return grain, shift, overlap
    apart = (clumps.body[grain[:, 0]] != clumps.body[grain[:, 1]]) | shift.any(axis=1)
    return grain[apart], shift[apart], overlap[apart]


def _connected(
    body: np.ndarray, position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the first sphere of the clump of each sphere, the positions, and the number of groups that are no clumps.

    The positions of the spheres of a clump are made contiguous across the faces of the cell.
    """
    grains = len(body)
    pairs, shift, _ = overlapping_pairs(position, (1.0 + NEAR) * radius, cell)
    inside = (body[pairs[:, 0]] == body[pairs[:, 1]]) & (body[pairs[:, 0]] >= 0)
    pairs, shift = pairs[inside], shift[inside]
    graph = coo_array((np.arange(1, len(pairs) + 1), tuple(pairs.T)), shape=(grains, grains)).tocsr()
    _, label = connected_components(graph, directed=False)
    first, place, lost = np.arange(grains), position.copy(), 0
    links = {tuple(pair): move for pair, move in zip(pairs.tolist(), shift @ cell.T, strict=True)}
    members = np.argsort(body, kind="stable")
    members = members[body[members] >= 0]
    for group in np.split(members, np.flatnonzero(np.diff(body[members])) + 1):
        if len(group) < 2:
            continue
        if (label[group] != label[group[0]]).any():
            lost += 1
            continue
        reached, before = breadth_first_order(graph, group[0], directed=False)
        for sphere in reached[1:]:
            other = before[sphere]
            move = links[other, sphere] if (other, sphere) in links else -links[sphere, other]
            place[sphere] = position[sphere] + move + place[other] - position[other]
        reach = np.linalg.norm(place[group] - place[group[0]], axis=1) + radius[group] + radius[group[0]]
        if reach.max() > WIDEST * widths(cell).min():
            place[group], lost = position[group], lost + 1
        else:
            first[group] = group.min()
    return first, place, lost


def _bodies(body: np.ndarray, position: np.ndarray, radius: np.ndarray) -> Clumps:
    """Return the clumps, at rest, that spheres form, body (sphere,); volume and inertia count overlaps once."""
    from scipy.spatial.transform import Rotation

    start = np.searchsorted(body, np.arange(body[-1] + 1))
    count, radii = np.diff([*start, len(body)]), radius[start]
    volume = 4.0 / 3.0 * np.pi * radii**3
    inertia = np.repeat((8.0 / 15.0 * np.pi * radii**5)[:, None], 3, axis=1)
    center, turn = position[start].copy(), np.tile([1.0, 0.0, 0.0, 0.0], (len(start), 1))
    arm = np.zeros_like(position)
    for number in np.flatnonzero(count > 1):
        rows = slice(start[number], start[number] + count[number])
        size = radius[rows].max()
        x = (position[rows] - position[rows][0]) / size
        full, middle, moment, axes = principal_moments(x, radius[rows] / size, COLUMNS)
        volume[number], inertia[number] = full * size**3, full * moment * size**5
        center[number] += size * middle
        arm[rows] = size * (x - middle) @ axes
        turn[number] = np.roll(Rotation.from_matrix(axes).as_quat(), 1)  # real part first
    still = np.zeros_like(center)
    return Clumps(body, arm, volume, inertia, center, still, turn, still)
