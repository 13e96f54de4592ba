"""Imports a file of another program as grains in SI units, as a Snapshot with the forces of the file, or as a State."""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path
from typing import Any

from labkit.errors import InputError, require_file_name, warn
from labkit.files.provenance import provenance_json
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.indicators import unbalanced_force
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.plugins.exchange.checks import require_packing
from labkit.plugins.exchange.formats import FORMATS, format_of
from labkit.plugins.exchange.joining import Imported, join_contacts
from labkit.plugins.exchange.packing import Answers, Packing
from labkit.records.limits import width_warning
from labkit.text.foreign import require_accepted

NUMBER = re.compile(r"\d{3,}")  # the number of a step in the name of a file
Name = str | os.PathLike[str]
UNBALANCED = 0.1  # unbalanced force above which grains are not in equilibrium
FEW = 100  # grains, below which a file is an example rather than a specimen
SAME_STRESS = 0.02  # relative difference of mean stresses up to which no message is needed


def other_stress(imported: Imported, state: State) -> str | None:
    """Compare the mean stress of the file's forces with the mean stress of the State; return a message if they differ.

    The message recommends a Young's modulus, because normal forces at given overlaps are proportional to it.
    """
    if imported.normal_force is None:
        return None
    theirs = float(mean_stress(love_stress(imported.snapshot(state.scene))))
    computed = float(mean_stress(love_stress(state.snapshot())))
    if computed <= 0.0 or theirs <= 0.0 or abs(computed / theirs - 1.0) < SAME_STRESS:
        return None
    modulus = state.scene.young_modulus
    return (
        f"the contact forces of the file have a mean stress of {theirs / 1e3:.4g} kPa, those of the state "
        f"{computed / 1e3:.4g} kPa, from the overlaps and E = {modulus:.4g} Pa: "
        f"--young-modulus {modulus * theirs / computed:.6g} keeps the stress of the file"
    )


def unrest(state: State) -> str | None:
    """Return a message if the grains of a State are far from equilibrium, or the cell is narrow; otherwise None."""
    snapshot = state.snapshot()
    doubts: list[str] = []
    if snapshot.number_of_grains < FEW:
        return None
    if len(snapshot.contacts) and (unbalanced := unbalanced_force(snapshot)) > UNBALANCED:
        doubts.append(
            f"the grains are not in equilibrium (unbalanced force {unbalanced:.2g}): check the box, also its tilt, "
            "the sizes and the contacts"
        )
    if (narrow := width_warning(state)) is not None:
        doubts.append(narrow)
    return "; ".join(doubts) or None


def read(file: Name, contacts: Name | None = None, format: str | None = None, **answers: Any) -> Imported:
    """Read the grains and contacts of a file. Raises InputError if information is missing.

    Args:
        file: File with the grains.
        contacts: File that lists the contacts, if `file` does not.
        format: Format of the file (default: recognised from its content).
        answers: Information that the file lacks, fields of labkit.plugins.exchange.packing.Answers.
    """
    require_file_name(file, "labkit.import_state('packing.csv', scene)")
    about = Answers(**answers)
    path = Path(file)
    reader = format_of(path, format)
    if not reader.can("read"):
        raise InputError(
            f"{path} is a {reader.name} file without grains: give a file of grains, and this with --contacts"
        )
    packing = reader.read(path, about)
    if not len(packing):
        raise InputError(f"{path} has no grains: give another file")
    if contacts is not None:
        packing = _with_contacts(packing, Path(contacts), about)
        numbers = [NUMBER.findall(Path(name).stem)[-1:] for name in (path, contacts)]
        if all(numbers) and numbers[0] != numbers[1]:
            packing = packing.with_notes(
                f"the file names have the numbers {numbers[0][0]} and {numbers[1][0]}: are they of one step?"
            )
    packing = about.complete(packing)
    require_packing(packing, path)
    return join_contacts(packing, about.first_id)


def _with_contacts(packing: Packing, file: Path, answers: Answers) -> Packing:
    """Return the packing with contacts read from a second file."""
    reader = format_of(file)
    if not reader.can("read_contacts"):
        names = ", ".join(name for name in FORMATS if FORMATS[name]().can("read_contacts"))
        raise InputError(f"{file} is a {reader.name} file without a contact list: give a file of {names}")
    contacts = reader.read_contacts(file, answers)
    return dataclasses.replace(packing, contacts=contacts)


def import_state(
    file: Name,
    scene: Scene | None = None,
    *,
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
        answers: Information that the file lacks, fields of labkit.plugins.exchange.packing.Answers.
    """
    imported = read(file, contacts, format, **answers)
    require_accepted(imported.findings, accept, "imports")
    warn(*map(str, imported.findings))
    state = imported.state(scene or Scene())
    warn(other_stress(imported, state), unrest(state))
    inputs = [name for name in (file, contacts) if name is not None]
    return state.replace(provenance=provenance_json(None, inputs), engine="import")


def import_snapshot(
    file: Name,
    scene: Scene | None = None,
    *,
    contacts: Name | None = None,
    format: str | None = None,
    accept: bool = False,
    **answers: object,
) -> Snapshot:
    """Make a Snapshot with the contact forces of another program's file; arguments and errors as for `import_state`."""
    imported = read(file, contacts, format, **answers)
    require_accepted(imported.findings, accept, "imports")
    return imported.snapshot(scene or Scene())
