"""Sanity checks of imported grains and contacts, which find mistakes in sizes, units, box and signs."""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.cells import widths
from labkit.micro.void_ratio import grain_volume

SAME_PLACE = 1e-6  # fraction of the mean diameter: two grains this close are one grain listed twice
DEEP = 0.05  # mean overlap over mean diameter, above labkit's limit of 0.02: worth a note
TOO_DEEP = 0.25  # mean overlap over mean diameter, which no contact law allows
DENSE = 0.15  # void ratio below which grains overlap too much for any packing of spheres
THIN = 3.0  # void ratio of touching grains above which sizes are probably too small
APART = 1e-3  # gap over mean diameter from which a listed contact counts as open: a time step opens smaller ones
DIFFERENT = 0.2  # relative difference between overlaps of a file and of its grains
MANY = 0.5  # share of contacts above which a mistake is certain rather than local
BALANCED = 0.5  # ratio of the resultant forces on grains below which the other sign of tangential forces is right
TENSE = 0.2  # share of overlapping contacts in tension above which the sign or the columns are wrong
SIZES = (1e-6, 0.1)  # plausible mean diameters of soil and of its models, m


@dataclasses.dataclass(frozen=True)
class Doubt:
    """Something implausible in a file; it is `serious` if a state made from the file would be useless."""

    text: str
    serious: bool = False

    def __str__(self) -> str:
        return self.text


def check_grains(
    position: np.ndarray,
    radius: np.ndarray,
    cell: np.ndarray,
    origin: np.ndarray | None,
    overlap: np.ndarray,
    grain: np.ndarray,
) -> list[Doubt]:
    """Check grains (SI units) and their overlapping pairs, overlap (m,) and grain (m, 2); returns the findings."""
    found = []
    diameter = 2.0 * radius.mean()
    if not SIZES[0] < diameter < SIZES[1]:
        found.append(Doubt(f"the mean diameter is {diameter:.3g} m: is --length-unit right?"))
    if widths(cell).min() < 2.0 * 2.0 * radius.max():
        text = f"the box is {widths(cell).min():.3g} m wide, less than two grains of {2 * radius.max():.3g} m"
        found.append(Doubt(f"{text}: is --box right?", True))
    found += _outside(position, cell, origin)
    distance = radius[grain].sum(axis=1) - overlap
    same = int((distance < SAME_PLACE * diameter).sum())
    if same:
        found.append(Doubt(f"{same} pairs of grains are at the same place: is a frame or a grain listed twice?", True))
    e = np.linalg.det(cell) / grain_volume(radius) - 1.0
    ratio = overlap.mean() / diameter if len(overlap) else 0.0
    if ratio > DEEP or e < DENSE:
        text = f"the mean overlap is {ratio:.0%} of the diameter and the void ratio {e:.2f}"
        serious = bool(ratio > TOO_DEEP or e < DENSE)
        found.append(Doubt(f"{text}: are the sizes diameters, not radii? is --box right?", serious))
    elif not len(overlap) and e > THIN:
        found.append(Doubt(f"no grains touch and the void ratio is {e:.1f}: are the sizes radii, not diameters?"))
    return found


def check_contacts(
    grain: np.ndarray, overlap: np.ndarray, listed: np.ndarray | None, normal_force: np.ndarray | None, diameter: float
) -> list[Doubt]:
    """Check overlaps (n,) of the grains and as listed, and normal forces, in SI units; returns the findings."""
    found = []
    apart = overlap < -APART * diameter
    if apart.any():
        gap = -overlap[apart].mean() / diameter
        text = f"{apart.mean():.1%} of the listed contacts are between grains that do not touch, {gap:.1%} of D apart"
        question = "are sizes, units, box and the numbers of the grains right?"
        found.append(Doubt(f"{text}: {question}", bool(apart.mean() > MANY)))
    if listed is not None and len(overlap) and np.isfinite(listed).all():
        size = np.abs(listed).mean()
        either_sign = min(float(np.abs(overlap - sign * listed).mean()) for sign in (1.0, -1.0))
        if size > 0.0 and either_sign > DIFFERENT * size:
            text = f"the overlaps in the file, {size / diameter:.2%} of D, differ from those of the grains"
            found.append(Doubt(f"{text}, {overlap.mean() / diameter:.2%}: are sizes, units and box right?"))
    if normal_force is not None and len(normal_force):
        touching = overlap > 0.0
        pulling = float((normal_force[touching] < 0.0).mean()) if touching.any() else 0.0
        if pulling > TENSE:
            text = f"{pulling:.0%} of the overlapping contacts are in tension"
            found.append(Doubt(f"{text}: are the sign of the forces and the columns right?", True))
        elif pulling > 0.0:
            found.append(Doubt(f"{pulling:.1%} of the overlapping contacts are in tension"))
    return found


def check_missing(
    grain: np.ndarray, pairs: np.ndarray, shift: np.ndarray, overlap: np.ndarray, diameter: float
) -> list[Doubt]:
    """Report overlapping pairs (m, 2) with shift (m, 3) and overlap (m,) that the contact list (n, 2) lacks."""
    deep = overlap > 1e-9 * diameter
    keys = {tuple(pair) for pair in np.sort(grain, axis=1).tolist()}
    missing = np.array([tuple(pair) not in keys for pair in pairs[deep].tolist()], dtype=bool)
    if not missing.any():
        return []
    across = int((missing & (shift[deep] != 0).any(axis=1)).sum())
    text = f"{int(missing.sum())} of {int(deep.sum())} overlapping pairs of grains are not in the contact list"
    where = f", {across} of them across faces of the box" if across else ""
    return [Doubt(f"{text}{where}: Z and stress are too low", bool(missing.mean() > MANY))]


def check_balance(
    grain: np.ndarray, normal: np.ndarray, normal_force: np.ndarray, tangential_force: np.ndarray, grains: int
) -> list[Doubt]:
    """Report if the forces on grains balance much better with the tangential forces (n, 3) reversed.

    At rest, the resultant force on each grain is zero. The normals (n, 3) and normal forces (n,) are as in Contacts.
    """
    resultant = []
    for sign in (1.0, -1.0):
        force = sign * tangential_force - normal_force[:, None] * normal
        total = np.zeros((grains, 3))
        np.add.at(total, grain[:, 0], force)
        np.add.at(total, grain[:, 1], -force)
        resultant.append(float(np.linalg.norm(total, axis=1).sum()))
    if resultant[1] >= BALANCED * resultant[0]:
        return []
    return [
        Doubt("the forces on grains balance only if tangential forces act on the other grain: is --force-on right?")
    ]


def _outside(position: np.ndarray, cell: np.ndarray, origin: np.ndarray | None) -> list[Doubt]:
    """Report grains outside the box or, if its corner is unknown, grains that no box of this size can hold."""
    if origin is not None:
        fraction = np.linalg.solve(cell, (position - origin).T).T
        outside = int(((fraction < 0.0) | (fraction > 1.0)).any(axis=1).sum())
        return [Doubt(f"{outside} grains lie outside the box: they count as periodic images")] if outside else []
    fraction = np.linalg.solve(cell, position.T).T
    wide = np.ptp(fraction, axis=0) > 1.0 + 1e-9
    if not wide.any():
        return []
    axes = ", ".join(np.array(list("xyz"))[wide])
    return [Doubt(f"the grains extend beyond the box in {axes}: they count as periodic images; is --box right?")]
