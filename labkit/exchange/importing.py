"""Imports a file of another program as grains in SI units, as a Snapshot with the forces of the file, or as a State."""

from __future__ import annotations

import dataclasses
import os
import re
import warnings
from pathlib import Path
from typing import Any, cast

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.errors import InputError, require_file_name
from labkit.exchange.checks import (
    check_balance,
    check_box,
    check_contacts,
    check_faces,
    check_grains,
    check_instant,
    check_missing,
    require_packing,
)
from labkit.exchange.clumps import pairs_between, with_clumps
from labkit.exchange.formats import FORMATS, format_of
from labkit.exchange.packing import Answers, ContactList, Packing
from labkit.exchange.packing import first_id as known_first_id
from labkit.exchange.pairs import nearest_shift, overlapping_pairs
from labkit.grains.grading import MOST_RATIO
from labkit.grains.lattice import reduction
from labkit.grains.scene import Scene
from labkit.grains.state import State, grains_in_cell
from labkit.grains.valid import require_valid
from labkit.io.foreign import Doubt, require_accepted
from labkit.io.provenance import provenance_json
from labkit.micro.bodies import snapshot_of_bodies
from labkit.micro.indicators import unbalanced_force
from labkit.micro.snapshot import Snapshot, branch_vectors, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import grain_volume
from labkit.records.limits import width_warning

NUMBER = re.compile(r"\d{3,}")  # the number of a step in the name of a file
Name = str | os.PathLike[str]
UNBALANCED = 0.1  # unbalanced force above which grains are not in equilibrium
FEW = 100  # grains, below which a file is an example rather than a specimen
SAME_STRESS = 0.02  # relative difference of mean stresses up to which no message is needed


@dataclasses.dataclass(frozen=True)
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

    def scene(self, scene: Scene) -> Scene:
        """Return the scene with the mean and the spread of the diameters of these grains.

        The spread is chosen so that a uniform distribution has the same standard deviation. It is smaller if the
        largest diameter would otherwise exceed MOST_RATIO times the smallest.
        """
        radius = self.radius if self.clumps is None else self.clumps.equivalent_radius(self.radius)
        widest = (MOST_RATIO - 1.0) / (MOST_RATIO + 1.0)
        spread = min(float(np.sqrt(3.0) * radius.std() / radius.mean()), 0.999 * widest)
        return scene.replace(mean_diameter=2.0 * float(radius.mean()), diameter_spread=spread)

    def state(self, scene: Scene) -> State:
        """Return a State at rest; normal forces follow from the overlaps and the contact law of the scene.

        Raises InputError for grains that a state cannot hold.
        """
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
        return snapshot_of_bodies(dataclasses.replace(spheres, contacts=contacts), state.bodies)


def other_stress(found: Imported, state: State) -> str | None:
    """Compare the mean stress of the file's forces with the mean stress of the State; return a message if they differ.

    The message recommends a Young's modulus, because normal forces at given overlaps are proportional to it.
    """
    if found.normal_force is None:
        return None
    theirs = float(mean_stress(love_stress(found.snapshot(state.scene))))
    own = float(mean_stress(love_stress(state.snapshot())))
    if own <= 0.0 or theirs <= 0.0 or abs(own / theirs - 1.0) < SAME_STRESS:
        return None
    modulus = state.scene.young_modulus
    return (
        f"the contact forces of the file have a mean stress of {theirs / 1e3:.4g} kPa, those of the state "
        f"{own / 1e3:.4g} kPa, from the overlaps and E = {modulus:.4g} Pa: "
        f"--young-modulus {modulus * theirs / own:.6g} keeps the stress of the file"
    )


def unrest(state: State) -> str | None:
    """Return a message if the grains of a State are far from equilibrium, or the cell is narrow; otherwise None."""
    snapshot = state.snapshot()
    found: list[str] = []
    if snapshot.number_of_grains < FEW:
        return None
    if len(snapshot.contacts) and (unbalanced := unbalanced_force(snapshot)) > UNBALANCED:
        found.append(
            f"the grains are not in equilibrium (unbalanced force {unbalanced:.2g}): check the box, also its tilt, "
            "the sizes and the contacts"
        )
    if (narrow := width_warning(state)) is not None:
        found.append(narrow)
    return "; ".join(found) or None


def read(file: Name, contacts: Name | None = None, format: str | None = None, **answers: Any) -> Imported:
    """Read the grains and contacts of a file. Raises InputError if information is missing.

    Args:
        file: File with the grains.
        contacts: File that lists the contacts, if `file` does not.
        format: Format of the file (default: recognised from its content).
        answers: Information that the file lacks, fields of labkit.exchange.packing.Answers.
    """
    require_file_name(file, "labkit.import_state('packing.csv', scene)")
    given = Answers(**answers)
    path = Path(file)
    found = format_of(path, format)
    if not found.reads:
        raise InputError(
            f"{path} is a {found.name} file without grains: give a file of grains, and this with --contacts"
        )
    packing = found.read(path, given)
    if not len(packing):
        raise InputError(f"{path} has no grains: give another file")
    if contacts is not None:
        packing = _with_contacts(packing, Path(contacts), given)
        numbers = [NUMBER.findall(Path(name).stem)[-1:] for name in (path, contacts)]
        if all(numbers) and numbers[0] != numbers[1]:
            packing = packing.with_notes(
                f"the file names have the numbers {numbers[0][0]} and {numbers[1][0]}: are they of one step?"
            )
    packing = given.complete(packing)
    require_packing(packing, path)
    return join_contacts(packing, given.first_id)


def join_contacts(packing: Packing, first_id: int | None = None) -> Imported:
    """Check a packing in SI units (Answers.complete); returns the grains and contacts with the findings."""
    if packing.contacts is not None and packing.id is None:
        first = known_first_id(packing.contacts.grain, len(packing)) if first_id is None else first_id
        packing = dataclasses.replace(packing, id=np.arange(first or 0, (first or 0) + len(packing)))
    given, listed_position = cast(np.ndarray, packing.cell), packing.position
    cell = given @ reduction(given)
    packing, clumps = with_clumps(dataclasses.replace(packing, cell=cell))
    position, radius = packing.position, cast(np.ndarray, packing.size)
    volume = grain_volume(radius) if clumps is None else float(clumps.body_volume.sum())
    pairs, shift, overlap = pairs_between(clumps, *overlapping_pairs(position, radius, cell))
    findings = []
    if (ratio := float(radius.max() / radius.min())) > MOST_RATIO:
        text = f"the diameters differ {ratio:.3g}-fold: the scene of the state allows at most {MOST_RATIO:g}-fold"
        findings.append(Doubt(text))
    findings += check_grains(position, radius, cell, volume, overlap, pairs)
    findings += check_box(listed_position, given, packing.origin)
    findings += check_faces(shift, overlap, 2.0 * float(radius.mean()))
    if packing.origin is not None:
        position = position - packing.origin
    if packing.contacts is None:
        zero, findings = np.zeros((len(pairs), 3)), [*findings, *map(Doubt, packing.notes)]
        return Imported(radius, position, cell, pairs, shift, None, zero, False, tuple(findings), clumps)
    contacts, notes = _between_grains(packing.contacts, cast(np.ndarray, packing.id), clumps)
    own = nearest_shift(position, cell, contacts.grain)
    branch = branch_vectors(position, cell, contacts.grain, own)
    distance = np.linalg.norm(branch, axis=1)
    depth = radius[contacts.grain].sum(axis=1) - distance
    direction = branch / distance[:, None]
    normal, tangential = _forces(contacts, direction)
    kept = (depth > 0.0) if normal is None else (normal != 0.0) | (depth > 0.0)
    if not kept.all():
        notes.append(f"{int((~kept).sum())} listed pairs neither touch nor carry a force: they are left out")
    contacts, normal = contacts.rows(kept), None if normal is None else normal[kept]
    own, depth, direction, tangential = own[kept], depth[kept], direction[kept], tangential[kept]
    diameter = 2.0 * float(radius.mean())
    findings += check_instant(packing.at, packing.contacts.at)
    findings += check_contacts(contacts.grain, depth, contacts.overlap, normal, diameter)
    if normal is not None:
        findings += check_balance(contacts.grain, direction, normal, tangential, len(radius))
    findings += check_missing(contacts.grain, pairs, shift, overlap, diameter)
    listed = _sort_by_grains(contacts.grain, own, normal, tangential)
    findings += map(Doubt, (*notes, *packing.contacts.notes, *packing.notes))
    return Imported(radius, position, cell, *listed, True, tuple(findings), clumps)


def _with_contacts(packing: Packing, file: Path, answers: Answers) -> Packing:
    """Return the packing with contacts read from a second file."""
    found = format_of(file)
    if not found.reads_contacts:
        names = ", ".join(name for name in FORMATS if FORMATS[name]().reads_contacts)
        raise InputError(f"{file} is a {found.name} file without a contact list: give a file of {names}")
    contacts = found.read_contacts(file, answers)
    return dataclasses.replace(packing, contacts=contacts)


def _between_grains(
    contacts: ContactList, identity: np.ndarray, clumps: Clumps | None
) -> tuple[ContactList, list[str]]:
    """Return contacts between different bodies, each once, with numbers instead of ids; and notes on omissions."""
    order = np.argsort(identity)
    place = np.searchsorted(identity[order], contacts.grain).clip(0, len(order) - 1)
    known = (identity[order][place] == contacts.grain).all(axis=1)
    if not known.any() and len(known):
        raise InputError("the contact list names no grain of the file of grains: do the two files belong together?")
    own = known & (contacts.grain[:, 0] == contacts.grain[:, 1])
    body = np.arange(len(identity)) if clumps is None else clumps.body
    within = known & ~own & (body[order[place]][:, 0] == body[order[place]][:, 1])
    contacts = dataclasses.replace(contacts, grain=order[place]).rows(known & ~own & ~within)
    _, first_listed = np.unique(np.sort(contacts.grain, axis=1), axis=0, return_index=True)
    notes = (
        (int((~known).sum()), "contacts with bodies that are not among the grains are left out"),
        (int(own.sum()), "contacts of a grain with itself are left out"),
        (int(within.sum()), "contacts within clumps are left out"),
        (len(contacts) - len(first_listed), "contacts are listed twice: the first of each is used"),
    )
    return contacts.rows(np.sort(first_listed)), [f"{count} {what}" for count, what in notes if count]


def _forces(contacts: ContactList, normal: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """Return normal force fn (n,), or None, and tangential force ft on the first grain (n, 3); total: ft - fn n."""
    if contacts.force is not None:
        size = -np.einsum("ci,ci->c", contacts.force, normal)
        return size, contacts.force + size[:, None] * normal
    tangential = contacts.tangential_force
    return contacts.normal_force, np.zeros((len(contacts), 3)) if tangential is None else tangential


def _sort_by_grains(
    grain: np.ndarray, shift: np.ndarray, normal: np.ndarray | None, tangential: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray]:
    """Sort contacts in the order of the engines, with the lower-numbered grain first."""
    swap = (grain[:, 0] > grain[:, 1])[:, None]
    shift, tangential = np.where(swap, -shift, shift), np.where(swap, -tangential, tangential)
    grain = np.sort(grain, axis=1)
    order = np.lexsort((grain[:, 1], grain[:, 0]))
    normal = None if normal is None else normal[order]
    return grain[order].astype(np.int32), shift[order].astype(np.int32), normal, tangential[order]


def import_state(
    file: Name,
    scene: Scene | None = None,
    contacts: Name | None = None,
    format: str | None = None,
    accept: bool = False,
    **answers: object,
) -> State:
    """Create a State at rest from another program's file, with the mean and spread of the grain sizes in its scene.

    Raises InputError if information is missing, or for a serious finding.

    Args:
        file: File with the grains.
        scene: Material of the grains.
        contacts: File that lists the contacts, if `file` does not.
        format: Format of the file (default: recognised from its content).
        accept: True to make the State despite serious findings.
        answers: Information that the file lacks, fields of labkit.exchange.packing.Answers.
    """
    found = read(file, contacts, format, **answers)
    require_accepted(found.findings, accept, "imports")
    for finding in found.findings:
        warnings.warn(str(finding), stacklevel=2)
    state = found.state(scene or Scene())
    for text in filter(None, (other_stress(found, state), unrest(state))):
        warnings.warn(text, stacklevel=2)
    inputs = [name for name in (file, contacts) if name is not None]
    return state.replace(provenance=provenance_json(None, inputs), engine="import")


def import_snapshot(
    file: Name,
    scene: Scene | None = None,
    contacts: Name | None = None,
    format: str | None = None,
    accept: bool = False,
    **answers: object,
) -> Snapshot:
    """Make a Snapshot with the contact forces of another program's file; arguments and errors as for `import_state`."""
    found = read(file, contacts, format, **answers)
    require_accepted(found.findings, accept, "imports")
    return found.snapshot(scene or Scene())
