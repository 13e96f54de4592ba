"""Grains and contacts of a file joined in SI units: as a State, or as a Snapshot with the forces of the file."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.errors import InputError
from labkit.grains.grading import MOST_RATIO, sizes_of
from labkit.grains.lattice import reduction
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.valid import require_valid
from labkit.micro.bodies import snapshot_of_bodies
from labkit.micro.snapshot import Snapshot, branch_vectors
from labkit.micro.void_ratio import grain_volume
from labkit.plugins.exchange.checks import (
    check_balance,
    check_box,
    check_contacts,
    check_faces,
    check_grains,
    check_instant,
    check_missing,
    check_points,
)
from labkit.plugins.exchange.clumps import pairs_between, with_clumps
from labkit.plugins.exchange.contact_list import ContactList, contact_normals, contact_vectors, of_spheres
from labkit.plugins.exchange.packing import Packing
from labkit.plugins.exchange.packing import first_id as known_first_id
from labkit.plugins.exchange.pairs import nearest_shift, overlapping_pairs
from labkit.text.foreign import Doubt


@dataclasses.dataclass(frozen=True, eq=False)
class Imported:
    """Grains and contacts of a file in SI units, and the findings of the checks.

    The contacts come from the list in the file. If the file has no list (`listed` is False), all overlapping pairs of
    grains are contacts.

    Args:
        radius: Radii, m, (grain,).
        position: Centres, m, (grain, 3).
        cell: Cell vectors as columns, m, (3, 3).
        grain: The two grains of each contact, (n, 2).
        shift: Periodic shift of the second grain, (n, 3).
        normal_force: Normal force, N, (n,), or None if the file has no forces.
        tangential_force: Tangential force on the first grain, N, (n, 3), zero if the file has no tangential forces.
        listed: True if the file lists contacts.
        findings: Implausible properties of the grains and contacts.
        clumps: Clumps that the grains form, or None.
        vectors: Contact vectors from the centres of the two grains to the contact point, m, (n, 2, 3), or None.
        normal: Contact normals from the first to the second grain, (n, 3), if there are contact vectors.
    """

    radius: np.ndarray
    position: np.ndarray
    cell: np.ndarray
    grain: np.ndarray
    shift: np.ndarray
    normal_force: np.ndarray | None
    tangential_force: np.ndarray
    listed: bool
    findings: tuple[Doubt, ...]
    clumps: Clumps | None = None
    vectors: np.ndarray | None = None
    normal: np.ndarray | None = None

    def scene(self, scene: Scene) -> Scene:
        """Return the scene with the mean and the spread of the diameters of these grains."""
        radius = self.radius if self.clumps is None else self.clumps.equivalent_radius(self.radius)
        return scene.replace(**sizes_of(radius))

    def state(self, scene: Scene) -> State:
        """Return a State at rest; normal forces follow from the overlaps and the contact law of the scene.

        Raises InputError for grains that a state cannot hold.
        """
        if self.vectors is not None:
            raise InputError(
                "the file has contact points, so the grains may have any shape, and a state holds spheres and clumps: "
                "use labkit statistics, or leave the points out of --contact-columns"
            )
        state = self._state(scene)
        try:
            require_valid(state)
        except ValueError as error:
            raise InputError(f"no state can be made of these grains: {error}") from None
        return state

    def _state(self, scene: Scene) -> State:
        scene = self.scene(scene)
        state = grains_in_cell(scene, self.radius, self.position, self.cell)
        return state.replace(
            contact_grain=self.grain,
            contact_shift=self.shift,
            tangential_force=self.tangential_force,
            rolling_moment=np.zeros_like(self.tangential_force),
            clumps=self.clumps,
        )

    def snapshot(self, scene: Scene) -> Snapshot:
        """Return a Snapshot with the forces in the file or, if it has none, normal forces from the scene's law."""
        state = self._state(scene)
        snapshot = state.snapshot()
        if self.normal_force is None:
            return snapshot
        spheres = snapshot.spheres
        contacts = dataclasses.replace(spheres.contacts, normal_force=self.normal_force)
        if self.vectors is not None and self.normal is not None:
            zero = np.zeros(len(contacts))
            contacts = dataclasses.replace(contacts, normal=self.normal, overlap=zero, vectors=self.vectors)
        return snapshot_of_bodies(dataclasses.replace(spheres, contacts=contacts), state.bodies)


def join_contacts(packing: Packing, first_id: int | None = None) -> Imported:
    """Check a packing in SI units (Answers.complete); returns the grains and contacts with the findings."""
    if packing.contacts is not None and packing.id is None:
        first = known_first_id(packing.contacts.grain, len(packing)) if first_id is None else first_id
        packing = dataclasses.replace(packing, id=np.arange(first or 0, (first or 0) + len(packing)))
    listed_cell, listed_position = cast(np.ndarray, packing.cell), packing.position
    cell = listed_cell @ reduction(listed_cell)
    packing, clumps = with_clumps(dataclasses.replace(packing, cell=cell))
    origin = np.zeros(3) if packing.origin is None else packing.origin
    position, radius = packing.position - origin, cast(np.ndarray, packing.size)
    volume = grain_volume(radius) if clumps is None else float(clumps.body_volume.sum())
    contacts, notes = _between_grains(packing, clumps)
    any_shape = False
    if contacts is not None:
        if clumps is None and contacts.point is not None:
            contacts = dataclasses.replace(contacts, point=contacts.point - origin)
            any_shape = not of_spheres(contact_vectors(contacts, position, cell)[0])
        contacts = _each_once(contacts, any_shape, notes)
    if any_shape and contacts is not None:
        pairs, shift, overlap = contacts.grain, np.zeros((len(contacts), 3)), np.zeros(len(contacts))
    else:
        pairs, shift, overlap = overlapping_pairs(packing.position, radius, cell)
    pairs, shift, overlap = pairs_between(clumps, pairs, shift, overlap)
    findings = []
    if (ratio := float(radius.max() / radius.min())) > MOST_RATIO:
        text = f"the diameters differ {ratio:.3g}-fold: the scene of the state allows at most {MOST_RATIO:g}-fold"
        findings.append(Doubt(text))
    findings += check_grains(packing.position, radius, cell, volume, overlap, pairs)
    findings += check_box(listed_position, listed_cell, packing.origin)
    findings += check_faces(shift, overlap, 2.0 * float(radius.mean()))
    grains = (radius, position, cell)
    if contacts is None or packing.contacts is None:
        zero = np.zeros((len(pairs), 3))
        imported, doubts = Imported(*grains, pairs, shift, None, zero, False, (), clumps), list[Doubt]()
    else:
        findings += check_instant(packing.at, packing.contacts.at)
        notes += packing.contacts.notes
        if any_shape:
            imported, doubts = _at_points(contacts, *grains, notes)
        else:
            imported, doubts = _of_spheres(contacts, *grains, clumps, notes)
            diameter = 2.0 * float(radius.mean())
            doubts += check_missing(contacts.grain, pairs, shift, overlap, diameter)
    findings += [*doubts, *map(Doubt, (*notes, *packing.notes))]
    return dataclasses.replace(imported, findings=tuple(findings))


def _of_spheres(
    contacts: ContactList,
    radius: np.ndarray,
    position: np.ndarray,
    cell: np.ndarray,
    clumps: Clumps | None,
    notes: list[str],
) -> tuple[Imported, list[Doubt]]:
    """Return the listed contacts of spheres, with normals between the centres, and the findings; adds to the notes."""
    shift = nearest_shift(position, cell, contacts.grain)
    branch = branch_vectors(position, cell, contacts.grain, shift)
    distance = np.linalg.norm(branch, axis=1)
    depth = radius[contacts.grain].sum(axis=1) - distance
    direction = branch / distance[:, None]
    normal, tangential = _forces(contacts, direction)
    acts = (depth > 0.0) if normal is None else (normal != 0.0) | (depth > 0.0)
    if not acts.all():
        notes.append(f"{int((~acts).sum())} listed pairs neither touch nor carry a force: they are left out")
    contacts, normal = contacts.rows(acts), None if normal is None else normal[acts]
    shift, depth, direction, tangential = shift[acts], depth[acts], direction[acts], tangential[acts]
    diameter = 2.0 * float(radius.mean())
    checks = check_contacts(contacts.grain, depth, contacts.overlap, normal, diameter)
    if normal is not None:
        checks += check_balance(contacts.grain, direction, normal, tangential, len(radius))
    grain, swap, order = _in_order(contacts.grain)
    shift, tangential = np.where(swap, -shift, shift)[order], np.where(swap, -tangential, tangential)[order]
    normal = None if normal is None else normal[order]
    return Imported(radius, position, cell, grain, shift, normal, tangential, True, (), clumps), checks


def _at_points(
    contacts: ContactList, radius: np.ndarray, position: np.ndarray, cell: np.ndarray, notes: list[str]
) -> tuple[Imported, list[Doubt]]:
    """Return the listed contacts that carry forces between grains of any shape, and the findings; adds to the notes."""
    force = contacts.normal_force if contacts.force is None else contacts.force.any(axis=1)
    if force is not None and not force.all():
        notes.append(f"{int((force == 0.0).sum())} listed contacts carry no force: they are left out")
        contacts = contacts.rows(force != 0.0)
    vectors, shift = contact_vectors(contacts, position, cell)
    normal = contact_normals(contacts, vectors)
    size, tangential = _forces(contacts, normal)
    checks = check_points(vectors, normal, radius[contacts.grain])
    touching = np.ones(len(contacts))
    checks += check_contacts(contacts.grain, touching, None, size, 2.0 * float(radius.mean()))
    checks += check_balance(contacts.grain, normal, cast(np.ndarray, size), tangential, len(radius))
    grain, swap, order = _in_order(contacts.grain)
    shift, tangential, normal = (np.where(swap, -each, each)[order] for each in (shift, tangential, normal))
    vectors = np.where(swap[:, :, None], vectors[:, ::-1], vectors)[order]
    size = cast(np.ndarray, size)[order]
    listed = Imported(radius, position, cell, grain, shift, size, tangential, True, (), None, vectors, normal)
    return listed, checks


def _between_grains(packing: Packing, clumps: Clumps | None) -> tuple[ContactList | None, list[str]]:
    """Return contacts between different bodies, with numbers instead of ids, or None; and notes on omissions."""
    contacts, identity = packing.contacts, cast(np.ndarray, packing.id)
    if contacts is None:
        return None, []
    order = np.argsort(identity)
    place = np.searchsorted(identity[order], contacts.grain).clip(0, len(order) - 1)
    listed = (identity[order][place] == contacts.grain).all(axis=1)
    if not listed.any() and len(listed):
        raise InputError("the contact list names no grain of the file of grains: do the two files belong together?")
    selfcontact = listed & (contacts.grain[:, 0] == contacts.grain[:, 1])
    body = np.arange(len(identity)) if clumps is None else clumps.body
    within = listed & ~selfcontact & (body[order[place]][:, 0] == body[order[place]][:, 1])
    contacts = dataclasses.replace(contacts, grain=order[place]).rows(listed & ~selfcontact & ~within)
    notes = (
        (int((~listed).sum()), "contacts with bodies that are not among the grains are left out"),
        (int(selfcontact.sum()), "contacts of a grain with itself are left out"),
        (int(within.sum()), "contacts within clumps are left out"),
    )
    return contacts, [f"{count} {what}" for count, what in notes if count]


def _each_once(contacts: ContactList, any_shape: bool, notes: list[str]) -> ContactList:
    """Return each contact once, for grains of any shape each point of a pair; adds to the notes."""
    keys = np.sort(contacts.grain, axis=1)
    if any_shape:
        keys = np.hstack([keys, cast(np.ndarray, contacts.point)])
    _, first_listed = np.unique(keys, axis=0, return_index=True)
    if (count := len(contacts) - len(first_listed)) > 0:
        notes.append(f"{count} contacts are listed twice: the first of each is used")
    return contacts.rows(np.sort(first_listed))


def _forces(contacts: ContactList, normal: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Return normal force fn (n,), or None, and tangential force ft on the first grain (n, 3); total: ft - fn n."""
    if contacts.force is not None:
        size = -np.einsum("ci,ci->c", contacts.force, normal)
        return size, contacts.force + size[:, None] * normal
    tangential = contacts.tangential_force
    return contacts.normal_force, np.zeros((len(contacts), 3)) if tangential is None else tangential


def _in_order(grain: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return contacts (n, 2) in the order of the engines, the lower number first; which are swapped; and the order."""
    first, second = np.sort(grain, axis=1).T
    order = np.lexsort((second, first))
    return np.stack([first, second], axis=1)[order].astype(np.int32), (grain[:, 0] > grain[:, 1])[:, None], order
