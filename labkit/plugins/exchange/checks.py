"""Sanity checks of imported grains and contacts, which find mistakes in sizes, units, box and signs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from labkit.errors import InputError
from labkit.grains.lattice import reduction
from labkit.grains.valid import FAR
from labkit.micro.cells import widths
from labkit.micro.void_ratio import grain_volume
from labkit.plugins.exchange.packing import Packing
from labkit.text.foreign import Doubt

FULL = 5.0  # volume of the grains over volume of the box, above which there are too many overlapping pairs to list
SAME_PLACE = 1e-6  # distance over mean diameter, below which two grains are one grain listed twice
DEEP = 0.05  # mean overlap over mean diameter that is worth a note; labkit's limit is 0.02
TOO_DEEP = 0.25  # mean overlap over mean diameter that no contact law allows
DENSE = 0.15  # void ratio below which grains overlap too much for any packing of spheres
THIN = 3.0  # void ratio above which the sizes of grains that should touch are probably too small
APART = 1e-3  # gap over mean diameter above which a listed contact is treated as open: one time step opens smaller gaps
DIFFERENT = 0.2  # relative difference between listed overlaps and overlaps of the grains that is worth a note
MANY = 0.5  # fraction of contacts above which a mistake is certain and not local
BALANCED = 0.5  # reversed tangential forces are right if they reduce the resultant forces on grains to this fraction
TENSE = 0.2  # fraction of overlapping contacts in tension above which the sign or the columns are wrong
LONG = 5.0  # mean distance of contact points over the radius of equal volume that no grains in contact have
SIZES = (1e-6, 0.1)  # plausible mean diameters of soil and of its models, m


def require_packing(packing: Packing, file: Path) -> None:
    """Raise InputError unless the arrays have the right shapes and contain usable numbers."""
    grains, cell = len(packing), cast(np.ndarray, packing.cell)
    _require_numbers(packing.position, (grains, 3), "positions", file)
    _require_numbers(packing.size, (grains,), "sizes", file)
    _require_numbers(cell, (3, 3), "a box", file)
    if not (cast(np.ndarray, packing.size) > 0.0).all():
        raise InputError(f"{file} has sizes that are not positive: repair the file")
    if not np.linalg.det(cell) > 0.0:
        raise InputError(f"{file} has a box without volume, or a left-handed one: give --box")
    largest = float(np.max(cast(np.ndarray, packing.size), initial=0.0))
    width = float(widths(cell @ reduction(cell)).min())
    if 2.0 * largest > width:  # no engine supports a grain that touches its own image
        raise InputError(
            f"{file} has a grain of {2.0 * largest:.3g} m in a box {width:.3g} m wide: repair it, or give --box"
        )
    filled = grain_volume(cast(np.ndarray, packing.size)) / np.linalg.det(cell)
    if filled > FULL:
        raise InputError(
            f"{file} has grains with {filled:.3g} times the volume of the box: are the sizes diameters, not radii? is "
            "--box right?"
        )
    _require_near(packing.position, cell, "grain", file)
    if packing.id is not None and len(np.unique(packing.id)) < grains:
        raise InputError(f"{file} has several grains with the same id: repair the file, or choose one frame of it")
    if (contacts := packing.contacts) is not None:
        for name in ("normal_force", "tangential_force", "force", "point", "normal"):
            values = getattr(contacts, name)
            shape = (len(contacts),) if name == "normal_force" else (len(contacts), 3)
            if values is not None:
                _require_numbers(values, shape, f"{name.replace('_', ' ')}s", "the contact list")
        if contacts.point is not None:
            _require_near(contacts.point, cell, "contact point", "the contact list")


def _require_near(places: np.ndarray, cell: np.ndarray, what: str, where: object) -> None:
    far = np.abs(np.linalg.solve(cell, places.T)).max(initial=0.0)
    if far > FAR:
        raise InputError(f"{where} has a {what} {far:.3g} boxes away: give the right --box, or repair the file")


def _require_numbers(values: np.ndarray | None, shape: tuple[int, ...], what: str, where: object) -> None:
    values = np.asarray(values)
    if values.shape != shape:
        raise InputError(f"{where} has {what} of shape {values.shape}, not {shape}: repair the file")
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise InputError(f"{where} has {what} with values that are not numbers: repair the file")


def check_grains(
    position: np.ndarray, radius: np.ndarray, cell: np.ndarray, volume: float, overlap: np.ndarray, grain: np.ndarray
) -> list[Doubt]:
    """Check grains (SI units), volume, and overlapping pairs, overlap (m,) and grain (m, 2); returns the findings."""
    doubts = []
    diameter = 2.0 * radius.mean()
    if not SIZES[0] < diameter < SIZES[1]:
        doubts.append(Doubt(f"the mean diameter is {diameter:.3g} m: is --length-unit right?"))
    if widths(cell).min() < 2.0 * 2.0 * radius.max():
        text = f"the box is {widths(cell).min():.3g} m wide, less than two grains of {2 * radius.max():.3g} m"
        doubts.append(Doubt(f"{text}: is --box right?", True))
    flat = np.ptp(position, axis=0) <= SAME_PLACE * diameter
    if flat.any() and len(radius) > 2:
        axes = ", ".join(np.array(list("xyz"))[flat])
        doubts.append(Doubt(f"all grains have the same {axes}: if they are discs, they become spheres"))
    distance = radius[grain].sum(axis=1) - overlap
    same = int((distance < SAME_PLACE * diameter).sum())
    if same:
        doubts.append(Doubt(f"{same} pairs of grains are at the same place: is a frame or a grain listed twice?", True))
    e = np.linalg.det(cell) / volume - 1.0
    ratio = overlap.mean() / diameter if len(overlap) else 0.0
    if ratio > DEEP or e < DENSE:
        text = f"the mean overlap is {ratio:.0%} of the diameter and the void ratio {e:.2f}"
        serious = bool(ratio > TOO_DEEP or e < DENSE)
        doubts.append(Doubt(f"{text}: are the sizes diameters, not radii? is --box right?", serious))
    elif not len(overlap) and e > THIN:
        doubts.append(Doubt(f"no grains touch and the void ratio is {e:.1f}: are the sizes radii, not diameters?"))
    elif e > THIN:
        touching = 2.0 * len(overlap) / len(radius)
        text = (
            f"the void ratio is {e:.1f}, but grains have {touching:.1f} contacts: is the box larger than the packing?"
        )
        doubts.append(Doubt(f"{text} Give the packing's own --box, for one that is periodic"))
    return doubts


def check_contacts(
    grain: np.ndarray, overlap: np.ndarray, listed: np.ndarray | None, normal_force: np.ndarray | None, diameter: float
) -> list[Doubt]:
    """Check overlaps (n,) of grains against listed overlaps, and normal forces, in SI units; returns the findings."""
    doubts = []
    apart = overlap < -APART * diameter
    if apart.any():
        gap = -overlap[apart].mean() / diameter
        text = f"{apart.mean():.1%} of the listed contacts are between grains that do not touch, {gap:.1%} of D apart"
        question = "are sizes, units, box and the numbers of the grains right?"
        doubts.append(Doubt(f"{text}: {question}", bool(apart.mean() > MANY)))
    if listed is not None and len(overlap) and np.isfinite(listed).all():
        size = np.abs(listed).mean()
        either_sign = min(float(np.abs(overlap - sign * listed).mean()) for sign in (1.0, -1.0))
        if size > 0.0 and either_sign > DIFFERENT * size:
            text = f"the overlaps in the file, {size / diameter:.2%} of D, differ from those of the grains"
            doubts.append(Doubt(f"{text}, {overlap.mean() / diameter:.2%}: are sizes, units and box right?"))
    if normal_force is not None and len(normal_force):
        touching = overlap > 0.0
        pulling = float((normal_force[touching] < 0.0).mean()) if touching.any() else 0.0
        if pulling > TENSE:
            text = f"{pulling:.0%} of the overlapping contacts are in tension"
            doubts.append(Doubt(f"{text}: are the sign of the forces and the columns right?", True))
        elif pulling > 0.0:
            doubts.append(Doubt(f"{pulling:.1%} of the overlapping contacts are in tension"))
    return doubts


def check_points(vectors: np.ndarray, normal: np.ndarray, radius: np.ndarray) -> list[Doubt]:
    """Check contact vectors (n, 2, 3) from the centres to the contact points, m, against the normals and the sizes.

    `radius` (n, 2) are the radii of spheres of equal volume, m.
    """
    doubts = [Doubt("contact points are given: the size of a grain is that of a sphere of equal volume")]
    reach = float((np.linalg.norm(vectors, axis=2) / radius).mean()) if len(vectors) else 1.0
    if not 1.0 / LONG < reach < LONG:
        text = f"the contact points are {reach:.2g} radii from the centres of their grains"
        doubts.append(Doubt(f"{text}: are they in the length unit and the frame of the grains? is --box right?", True))
    outward = np.einsum("csi,ci->cs", vectors, normal) * (1.0, -1.0)
    if (behind := float((outward < 0.0).mean()) if len(outward) else 0.0) > TENSE:
        text = f"{behind:.0%} of the contact points lie behind the centres of their grains"
        doubts.append(Doubt(f"{text}: are the columns of points and normals right?", True))
    return doubts


def check_missing(
    grain: np.ndarray, pairs: np.ndarray, shift: np.ndarray, overlap: np.ndarray, diameter: float
) -> list[Doubt]:
    """Report overlapping pairs (m, 2), with shift (m, 3) and overlap (m,), that are not in the contact list (n, 2)."""
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
    """Report if the forces on the grains balance much better when the tangential forces (n, 3) are reversed.

    At rest, the resultant force on each grain is zero. Normals (n, 3) and normal forces (n,) are as in Contacts.
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


def check_instant(grains: Mapping[str, float], contacts: Mapping[str, float]) -> list[Doubt]:
    """Report if grains and contacts are from different steps or times."""
    return [
        Doubt(f"the grains are of {name} {grains[name]:.10g}, the contacts of {name} {contacts[name]:.10g}", True)
        for name in ("step", "time")
        if name in grains and name in contacts and not np.isclose(grains[name], contacts[name], rtol=1e-6)
    ][:1]


def check_faces(shift: np.ndarray, overlap: np.ndarray, diameter: float) -> list[Doubt]:
    """Report if pairs across faces of the box, shift (m, 3), overlap (m,) far more deeply than pairs inside the box."""
    across = (shift != 0).any(axis=1)
    if not across.any():
        return []
    deepest, inside = overlap[across].max() / diameter, overlap[~across].max(initial=0.0) / diameter
    if deepest < max(TOO_DEEP, 3.0 * inside):
        return []
    text = f"grains overlap by up to {deepest:.0%} of the diameter across faces of the box, by {inside:.0%} inside"
    return [Doubt(f"{text}: has the box lost its shear? is --box right?", True)]


def check_box(position: np.ndarray, cell: np.ndarray, origin: np.ndarray | None) -> list[Doubt]:
    """Report grains outside the box or, if its corner is unknown, grains that do not fit in any box of this size."""
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
