"""Files of LAMMPS: data files (atom style sphere or bpm/sphere), and dumps of grains and of contacts."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.files.atomic import write_text
from labkit.grains.state import State
from labkit.plugins.exchange.columns import (
    CONTACT,
    GRAIN,
    contacts_from,
    grains_from,
    number_in,
    require_length,
    same_length,
)
from labkit.plugins.exchange.contact_list import ContactList
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import (
    FIRST,
    Answers,
    Packing,
    answer_names,
    frame_number,
    require_count,
    triclinic,
)
from labkit.plugins.exchange.pairs import wrapped_with_images
from labkit.text.reading import is_real, real, text_of, whole

UNITS = {  # style of units -> (length in m, force in N)
    "si": (1.0, 1.0),
    "cgs": (1e-2, 1e-5),
    "micro": (1e-6, 1e-9),
    "nano": (1e-9, 1e-12),
    "real": (1e-10, 6.947695e-11),
    "metal": (1e-10, 1.602176634e-9),
}


def _packing(
    columns: Mapping[str, np.ndarray],
    file: Path,
    style: str | None,
    cell: np.ndarray,
    origin: np.ndarray,
    at: Mapping[str, float],
) -> Packing:
    """Return the grains of columns, in the units of a style; None if it is unknown or dimensionless (lj)."""
    metre, newton = UNITS.get(style or "", (None, None))
    return dataclasses.replace(
        grains_from(columns, file), cell=cell, origin=origin, length_unit=metre, force_unit=newton, at=at
    )


STYLES = {  # atom style -> columns of the section Atoms
    "sphere": ("id", "-", "diameter", "-", "x", "y", "z"),
    "bpm/sphere": ("id", "-", "-", "diameter", "-", "x", "y", "z"),
}
BOUNDS = re.compile(r"^[ \t]*(\S+)[ \t]+(\S+)[ \t]+([xyz])lo[ \t]+[xyz]hi", re.MULTILINE)
TILTS = re.compile(r"^[ \t]*(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]+xy[ \t]+xz[ \t]+yz", re.MULTILINE)
VECTORS = re.compile(r"^[ \t]*(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]+([abc])vec", re.MULTILINE)
ORIGIN = re.compile(r"^[ \t]*(\S+)[ \t]+(\S+)[ \t]+(\S+)[ \t]+abc[ \t]+origin", re.MULTILINE)
COUNT = re.compile(r"^[ \t]*(\d+)[ \t]+atoms[ \t]*(?:#.*)?$", re.MULTILINE)
STEP = re.compile(r"\btimestep\s*=\s*(\d+)")
ATOMS = re.compile(r"^[ \t]*Atoms[ \t]*(?:#[ \t]*([\w/]+)?[^\n]*)?\n", re.MULTILINE)


class LammpsData(Format):
    """A data file. Sizes are diameters; the first line names the units if LAMMPS wrote the file."""

    name = "lammps_data"
    description = "LAMMPS data file"
    endings = (".data", ".lmp", ".lammps")

    def recognises(self, file: Path, head: str) -> bool:
        return bool(COUNT.search(head) and (BOUNDS.search(head) or VECTORS.search(head)))

    def read(self, file: Path, answers: Answers) -> Packing:
        first, _, text = text_of(file).partition("\n")
        section, count = ATOMS.search(text), COUNT.search(text)
        if count is None and COUNT.search(first):
            raise damaged_file(file, "LAMMPS takes its first line for a comment, and it is the number of atoms")
        if section is None or count is None:
            raise damaged_file(file, "it has no section Atoms")
        if len(ATOMS.findall(text)) > 1:
            raise damaged_file(file, "it has two sections Atoms")
        lines = (line.partition("#")[0].split() for line in text[section.end() :].splitlines())
        rows = [*itertools.takewhile(lambda words: is_real(words[0]), filter(None, lines))]  # up to the next section
        style = section[1]
        names = answer_names(answers.columns) or STYLES.get(style or "sphere")
        if names is None or (style is None and answers.columns is None and not _may_be_spheres(rows)):
            what = f"atom style {style}, which has no grain sizes" if style else "atoms of an unnamed style"
            what = "atom style hybrid, which does not name its columns" if style == "hybrid" else what
            example = f"{len(rows[0])} columns of the section Atoms" if rows else "columns of the section Atoms"
            raise InputError(
                f"{file} has {what}: name the {example} with --columns, e.g. id,-,diameter,-,x,y,z, where - skips one"
            )
        try:
            values = same_length([[number_in(*cell) for cell in zip(row, names, strict=False)] for row in rows])
            cell, origin = _cell_of_data(text)
        except ValueError as error:
            raise damaged_file(file, error) from None
        require_count(file, int(count[1]), len(rows), "atoms")
        columns, _ = GRAIN.columns(names, values, file)
        units = re.search(r"units\s*=\s*(\w+)", first)
        step = STEP.search(first)
        at = {"step": int(step[1])} if step else {}
        return _packing(columns, file, units[1] if units else None, cell, origin, at)

    def write(self, state: State, file: Path) -> None:
        """Write the grains in SI units, in LAMMPS's orientation of the cell (see `standard_orientation`)."""
        cell, rotation = standard_orientation(state.cell)
        position, velocity = state.position @ rotation.T, state.velocity @ rotation.T
        spin = state.angular_velocity @ rotation.T
        wrapped, image = wrapped_with_images(position, cell)
        lengths, (xy, xz, yz) = np.diag(cell).tolist(), cell[[0, 0, 1], [1, 2, 2]].tolist()
        lines = ["LAMMPS data file written by labkit, units = si", "", f"{len(wrapped)} atoms", "1 atom types", ""]
        lines += [f"0.0 {length!r} {axis}lo {axis}hi" for length, axis in zip(lengths, "xyz", strict=True)]
        lines += [f"{xy!r} {xz!r} {yz!r} xy xz yz", "", "Atoms # sphere", ""]
        for number in range(len(wrapped)):
            place = " ".join(map(repr, wrapped[number].tolist()))
            turns = " ".join(map(str, image[number].tolist()))
            diameter = 2.0 * float(state.radius[number])
            lines.append(f"{number + 1} 1 {diameter!r} {state.scene.density!r} {place} {turns}")
        lines += ["", "Velocities", ""]
        rows = np.column_stack([velocity, spin]).tolist()
        lines += [f"{number} {' '.join(map(repr, row))}" for number, row in enumerate(rows, 1)]
        write_text(file, "\n".join(lines) + "\n")


def _may_be_spheres(rows: list[list[str]]) -> bool:
    """Return True if rows of an unnamed style may be id, type, diameter, density, x, y, z, and perhaps image flags.

    In molecular styles with seven columns, the third column is the type, which is a whole number.
    """
    return bool(rows) and len(rows[0]) in (7, 10) and not all(row[2].isdigit() for row in rows if len(row) > 2)


def _cell_of_data(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Read (cell, origin) from the header of a data file. Raises ValueError if the box is missing."""
    vectors = {match[4]: [real(match[k]) for k in (1, 2, 3)] for match in VECTORS.finditer(text)}
    if set(vectors) == {"a", "b", "c"}:
        origin = ORIGIN.search(text)
        corner = np.zeros(3) if origin is None else np.array([real(origin[k]) for k in (1, 2, 3)])
        return np.array([vectors[name] for name in "abc"]).T, corner
    bounds = {match[3]: (real(match[1]), real(match[2])) for match in BOUNDS.finditer(text)}
    if set(bounds) != {"x", "y", "z"}:
        raise ValueError("it has no box")
    low, high = (np.array([bounds[axis][k] for axis in "xyz"]) for k in (0, 1))
    tilts = TILTS.search(text)
    return triclinic(high - low, *([] if tilts is None else [real(tilts[k]) for k in (1, 2, 3)])), low


def standard_orientation(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotate a cell so that its first vector is along x and its second in the x-y plane; returns (cell, rotation).

    LAMMPS supports only such cells, with tilts of at most half an edge. With the QR decomposition H = Q R, the rotated
    cell is R with a positive diagonal.
    """
    orthogonal, upper = np.linalg.qr(cell)
    sign = np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    rotated, rotation = upper * sign[:, None], (orthogonal * sign).T
    rotated[np.tril_indices(3, -1)] = 0.0
    for column, row in ((2, 1), (2, 0), (1, 0)):  # LAMMPS refuses a tilt above half an edge: use an equivalent cell
        rotated[:, column] -= np.rint(rotated[row, column] / rotated[row, row]) * rotated[:, row]
    return rotated, rotation


SCALED = (("xs", "ys", "zs"), ("xsu", "ysu", "zsu"))


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """One frame: box, names of the columns after ITEM: ATOMS or ENTRIES, their values (n, k), notes, units, instant."""

    cell: np.ndarray
    origin: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    notes: tuple[str, ...]
    units: str | None
    at: Mapping[str, float]


class LammpsDump(Format):
    """Grains in a file of `dump custom`. The last frame is read unless the user chooses a different frame."""

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
        packing = _packing(columns, file, frame.units, frame.cell, frame.origin, frame.at)
        return packing.with_notes(*frame.notes, *_left_out(columns.get("id")))


def _left_out(ids: np.ndarray | None) -> list[str]:
    """Say that ids are missing, as in a dump of a group, a region or a threshold; empty if they are consecutive."""
    if ids is None or not len(ids) or not (missing := int(ids.max() - ids.min()) + 1 - len(ids)) > 0:
        return []
    return [f"{missing} ids from {ids.min():g} to {ids.max():g} are not in the dump: is it one of all atoms?"]


class LammpsLocal(Format):
    """Contacts in a file of `dump local`. LAMMPS names columns after computes; --contact-columns gives their meaning.

    The forces from `compute pair/local` act on the first of the two atoms that `compute property/local` lists.
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
        return dataclasses.replace(contacts_from(columns, file), acts_on=FIRST, at=frame.at)


def frame_of(file: Path, answers: Answers) -> Frame:
    """Read the frame that the user chooses, or the last frame, of a dump file. Raises InputError."""
    lines = text_of(file).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    units = next((lines[k + 1].strip() for k, line in enumerate(lines[:20]) if line.startswith("ITEM: UNITS")), None)
    if not starts:
        raise damaged_file(file, "it has no ITEM: TIMESTEP")
    number, notes = frame_number(len(starts), answers, file)
    end = [*starts[1:], len(lines)][number]
    try:
        frame = _parse(lines[starts[number] : end], units, file)
    except (ValueError, IndexError, OverflowError) as error:
        raise damaged_file(file, error) from None
    notes = [f"{note} (step {frame.at['step']:.0f})" for note in notes]
    return dataclasses.replace(frame, notes=(*notes, *frame.notes))


def _parse(lines: list[str], units: str | None, file: Path) -> Frame:
    """Parse a frame. Raises ValueError or IndexError if it is damaged."""
    lines = [line for line in lines if line.strip()]
    marks = [k for k, line in enumerate(lines) if line.startswith("ITEM:")]
    items = {lines[a]: lines[a + 1 : b] for a, b in itertools.pairwise([*marks, len(lines)])}

    def item(*names: str) -> tuple[list[str], list[str]]:
        """Return the words after `ITEM:` and one of these names, and the lines below it."""
        line = next((words for words in items if words.split()[1] in names), None)
        if line is None:
            raise ValueError(f"it has no ITEM: {names[0]}")
        return line.split()[2:], items[line]

    step, count = (whole(item(name)[1][0]) for name in ("TIMESTEP", "NUMBER"))
    at = {"step": float(step)}
    if "ITEM: TIME" in items:
        at["time"] = real(items["ITEM: TIME"][0])
    names, rows = lines[marks[-1]].split()[2:], lines[marks[-1] + 1 :]  # dump_modify label may name these otherwise
    of_atoms, bounds, cell, origin = "ITEM: ATOMS" in lines[marks[-1]], list[str](), np.eye(3), np.zeros(3)
    if of_atoms or any(line.startswith("ITEM: BOX") for line in lines):
        (_, *bounds), box = item("BOX")
        cell, origin = _cell_of_dump(bounds, same_length([[real(word) for word in line.split()] for line in box[:3]]))
    require_count(file, count, len(rows), "atoms" if of_atoms else "entries")
    words = [line.split() for line in rows]
    require_length(words, len(names))
    used = [k for k in range(len(names)) if not words or is_real(words[0][k])]
    values = np.array([[real(row[k]) for k in used] for row in words]).reshape(count, len(used))
    flags = [word for word in bounds if len(word) == 2 and set(word) <= set("pfsm")]
    axes = ", ".join(axis for axis, flag in zip("xyz", flags, strict=False) if flag != "pp")
    note = f"the box is not periodic in {axes}; labkit's cell is periodic in x, y and z"
    return Frame(cell, origin, tuple(names[k] for k in used), values, (note,) if axes else (), units, at)


def _cell_of_dump(words: list[str], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (cell, origin) from the words after BOX BOUNDS and the three rows below.

    In a restricted triclinic dump, the rows give the bounding box of the cell, xlo + min(0, xy, xz, xy + xz) and so on.
    In a general triclinic dump (`abc origin`), the rows give the cell vectors and the origin.
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
