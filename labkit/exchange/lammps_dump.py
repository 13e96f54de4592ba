"""LAMMPS dump files: grains (dump custom) and contacts (dump local); text, one or several frames, triclinic boxes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers, names_of
from labkit.exchange.columns import CONTACT, GRAIN, chosen, contacts_from, grains_from
from labkit.exchange.formats import Format, damaged, text_of
from labkit.exchange.lammps_units import units_of_style
from labkit.exchange.packing import FIRST, ContactList, Packing, triclinic

SCALED = (("xs", "ys", "zs"), ("xsu", "ysu", "zsu"))


@dataclasses.dataclass(frozen=True)
class Frame:
    """One frame: step, box, names of the columns after ITEM: ATOMS or ENTRIES, and their values (n, k)."""

    step: int
    cell: np.ndarray
    origin: np.ndarray
    periodic: str
    names: tuple[str, ...]
    values: np.ndarray


class LammpsDump(Format):
    """Grains of a dump custom. The last frame is read unless another is chosen."""

    name = "lammps_dump"
    description = "LAMMPS dump of atoms"
    endings = (".dump", ".lammpstrj")

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith("ITEM:") and "ITEM: ATOMS" in head

    def read(self, file: Path, answers: Answers) -> Packing:
        frame, units, note = frame_of(file, answers)
        names = names_of(answers.columns) or frame.names
        values = frame.values
        for scaled in SCALED:
            if set(scaled) <= set(names) and not {"x", "xu"} & set(names):
                places = [names.index(name) for name in scaled]
                values = values.copy()
                values[:, places] = values[:, places] @ frame.cell.T + frame.origin
                names = ["xyz"[scaled.index(name)] if name in scaled else name for name in names]
        if {"x", "xu"} <= set(names):
            names = ["-" if name in ("xu", "yu", "zu") else name for name in names]
        columns, _ = chosen(list(names), values, GRAIN, file)
        position, size, size_is, identity = grains_from(columns, file)
        if identity is not None:
            order = np.argsort(identity)
            position, identity = position[order], identity[order]
            size = None if size is None else size[order]
        metre, newton = units_of_style(units)
        packing = Packing(
            position, size, size_is, identity, frame.cell, frame.origin, length_unit=metre, force_unit=newton
        )
        return packing.noting(*note, *not_periodic(frame))


class LammpsLocal(Format):
    """Contacts of a dump local. LAMMPS names columns after computes, c_pair[1]: --contact-columns says what they are.

    The forces of compute pair/local act on the first of the two atoms of compute property/local.
    """

    name = "lammps_local"
    description = "LAMMPS dump local of contacts"
    endings = (".local",)

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith("ITEM:") and "ITEM: ATOMS" not in head

    def read_contacts(self, file: Path, answers: Answers) -> ContactList:
        frame, _, _ = frame_of(file, answers)
        names = names_of(answers.contact_columns) or frame.names
        columns, _ = chosen(list(names), frame.values, CONTACT, file)
        return dataclasses.replace(contacts_from(columns, file), acts_on=FIRST)


def frame_of(file: Path, answers: Answers) -> tuple[Frame, str | None, list[str]]:
    """(frame, unit style, notes): the chosen or the last frame of a dump file. Raises InputError."""
    lines = text_of(file).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    units = next((lines[k + 1].strip() for k, line in enumerate(lines[:20]) if line.startswith("ITEM: UNITS")), None)
    if not starts:
        raise damaged(file, "it has no ITEM: TIMESTEP")
    number = -1 if answers.frame is None else answers.frame
    if not -len(starts) <= number < len(starts):
        raise InputError(
            f"is not in {file}, which has {len(starts)}", field="frame", value=number, allowed="another number"
        )
    first = starts[number]
    try:
        frame = _parsed(lines, first)
    except (ValueError, IndexError, KeyError) as error:
        raise damaged(file, error) from None
    many = len(starts) > 1 and answers.frame is None
    return frame, units, [f"step {frame.step} is read, the last of {len(starts)} frames"] if many else []


def _parsed(lines: list[str], first: int) -> Frame:
    step, count, at = int(lines[first + 1]), 0, first + 2
    cell, origin, flags = np.zeros((3, 3)), np.zeros(3), ""
    while True:
        words = lines[at].split()
        if words[1:3] == ["NUMBER", "OF"]:
            count, at = int(lines[at + 1]), at + 2
        elif words[1:3] == ["BOX", "BOUNDS"]:
            rows = np.array([[float(word) for word in line.split()] for line in lines[at + 1 : at + 4]])
            cell, origin = box_of(words[3:], rows)
            flags, at = " ".join(word for word in words[3:] if len(word) == 2 and set(word) <= set("pfsm")), at + 4
        elif words[1] in ("ATOMS", "ENTRIES"):
            words_of = [line.split() for line in lines[at + 1 : at + 1 + count]]
            names = tuple(words[2:])
            number = [k for k, name in enumerate(names) if all(_is_number(row[k]) for row in words_of[:1])]
            values = np.array([[float(row[k]) for k in number] for row in words_of]).reshape(count, len(number))
            return Frame(step, cell, origin, flags, tuple(names[k] for k in number), values)
        else:  # ITEM: UNITS, TIME and others
            at += 2


def box_of(words: list[str], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(cell, origin) from the words after BOX BOUNDS and the three rows below.

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


def not_periodic(frame: Frame) -> list[str]:
    """A note if the box of a dump is not periodic in some direction."""
    axes = [axis for axis, flag in zip("xyz", frame.periodic.split(), strict=False) if flag != "pp"]
    return [f"the box is not periodic in {', '.join(axes)}; labkit's cell is periodic in x, y and z"] if axes else []


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
