"""LAMMPS dump files: grains (dump custom) and contacts (dump local); text, one or several frames, triclinic boxes."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers, answer_names
from labkit.exchange.columns import CONTACT, GRAIN, contacts_from, grains_from, is_number, same_length
from labkit.exchange.formats import Format, damaged_file, whole_text
from labkit.exchange.lammps_units import units_of_style
from labkit.exchange.packing import FIRST, ContactList, Packing, triclinic

SCALED = (("xs", "ys", "zs"), ("xsu", "ysu", "zsu"))


@dataclasses.dataclass(frozen=True)
class Frame:
    """One frame: its box, the names of the columns after ITEM: ATOMS or ENTRIES, their values (n, k), and notes."""

    cell: np.ndarray
    origin: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    notes: tuple[str, ...]
    units: str | None


class LammpsDump(Format):
    """Grains of a dump custom. The last frame is read unless another is chosen."""

    name = "lammps_dump"
    description = "LAMMPS dump of atoms"
    endings = (".dump", ".lammpstrj")

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith("ITEM:") and "ITEM: ATOMS" in head

    def read(self, file: Path, answers: Answers) -> Packing:
        frame = frame_of(file, answers)
        names = answer_names(answers.columns) or frame.names
        values = frame.values
        for scaled in SCALED:
            if set(scaled) <= set(names) and not {"x", "xu"} & set(names):
                places = [names.index(name) for name in scaled]
                values = values.copy()
                values[:, places] = values[:, places] @ frame.cell.T + frame.origin
                names = ["xyz"[scaled.index(name)] if name in scaled else name for name in names]
        if {"x", "xu"} <= set(names):
            names = ["-" if name in ("xu", "yu", "zu") else name for name in names]
        columns, _ = GRAIN.columns(names, values, file)
        if "id" in columns:
            order = np.argsort(columns["id"])
            columns = {name: column[order] for name, column in columns.items()}
        metre, newton = units_of_style(frame.units)
        packing = dataclasses.replace(
            grains_from(columns, file), cell=frame.cell, origin=frame.origin, length_unit=metre, force_unit=newton
        )
        return packing.noting(*frame.notes)


class LammpsLocal(Format):
    """Contacts of a dump local. LAMMPS names columns after computes (c_pair[1]); --contact-columns gives their meaning.

    The forces of compute pair/local act on the first of the two atoms of compute property/local.
    """

    name = "lammps_local"
    description = "LAMMPS dump local of contacts"
    endings = (".local",)

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith("ITEM:") and "ITEM: ATOMS" not in head

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        frame = frame_of(file, answers)
        names = answer_names(answers.contact_columns) or frame.names
        columns, _ = CONTACT.columns(names, frame.values, file)
        return dataclasses.replace(contacts_from(columns, file), acts_on=FIRST)


def frame_of(file: Path, answers: Answers) -> Frame:
    """Read the chosen or the last frame of a dump file. Raises InputError."""
    lines = whole_text(file).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    units = next((lines[k + 1].strip() for k, line in enumerate(lines[:20]) if line.startswith("ITEM: UNITS")), None)
    if not starts:
        raise damaged_file(file, "it has no ITEM: TIMESTEP")
    number = -1 if answers.frame is None else answers.frame
    if not -len(starts) <= number < len(starts):
        raise InputError(
            f"is not in {file}, which has {len(starts)}", field="frame", value=number, allowed="another number"
        )
    end = [*starts[1:], len(lines)][number]
    try:
        frame, step = _parse(lines[starts[number] : end], units)
    except (ValueError, IndexError) as error:
        raise damaged_file(file, error) from None
    if len(starts) > 1 and answers.frame is None:
        note = f"step {step} is read, the last of {len(starts)} frames"
        frame = dataclasses.replace(frame, notes=(note, *frame.notes))
    return frame


def _parse(lines: list[str], units: str | None) -> tuple[Frame, int]:
    """Parse a frame; returns it and its step. Raises ValueError or IndexError if it is damaged."""
    marks = [k for k, line in enumerate(lines) if line.startswith("ITEM:")]
    items = {lines[a]: lines[a + 1 : b] for a, b in itertools.pairwise([*marks, len(lines)])}

    def item(*names: str) -> tuple[list[str], list[str]]:
        """Return the words after one of these names, and the lines below."""
        found = next((words for words in items if words.split()[1] in names), None)
        if found is None:
            raise ValueError(f"it has no ITEM: {names[0]}")
        return found.split()[2:], items[found]

    step, count = int(item("TIMESTEP")[1][0]), int(item("NUMBER")[1][0])
    (_, *bounds), box = item("BOX")
    names, rows = item("ATOMS", "ENTRIES")
    cell, origin = _cell_and_origin(bounds, same_length([[float(word) for word in line.split()] for line in box[:3]]))
    words = [line.split() for line in rows[:count]]
    used = [k for k in range(len(names)) if not words or is_number(words[0][k])]
    values = np.array([[float(row[k]) for k in used] for row in words]).reshape(count, len(used))
    flags = [word for word in bounds if len(word) == 2 and set(word) <= set("pfsm")]
    axes = ", ".join(axis for axis, flag in zip("xyz", flags, strict=False) if flag != "pp")
    note = f"the box is not periodic in {axes}; labkit's cell is periodic in x, y and z"
    return Frame(cell, origin, tuple(names[k] for k in used), values, (note,) if axes else (), units), step


def _cell_and_origin(words: list[str], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (cell, origin) from the words after BOX BOUNDS and the three rows below.

    In a restricted triclinic dump the bounds are those of the bounding box, xlo + min(0, xy, xz, xy + xz) and so on; in
    a general one (`abc origin`) the rows are the cell vectors and the origin.
    """
    if "abc" in words:
        return rows[:, :3].T, rows[:, 3]
    low, high = rows[:, 0].copy(), rows[:, 1].copy()
    if "xy" not in words:
        return triclinic(high - low), low
    xy, xz, yz = rows[:, 2]
    low[0] -= min(0.0, xy, xz, xy + xz)
    high[0] -= max(0.0, xy, xz, xy + xz)
    low[1] -= min(0.0, yz)
    high[1] -= max(0.0, yz)
    return triclinic(high - low, xy, xz, yz), low
