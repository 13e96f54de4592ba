"""LAMMPS data files (read_data, write_data) with atom style sphere or bpm/sphere: diameters, and triclinic boxes."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers, answer_names
from labkit.exchange.columns import GRAIN, grains_from, same_length
from labkit.exchange.formats import Format, damaged_file, whole_text
from labkit.exchange.lammps_units import units_of_style
from labkit.exchange.packing import Packing, triclinic
from labkit.exchange.pairs import wrapped_with_images
from labkit.grains.state import State
from labkit.io.atomic import write_text

STYLES = {  # columns of the section Atoms
    "sphere": ("id", "-", "diameter", "-", "x", "y", "z"),
    "bpm/sphere": ("id", "-", "-", "diameter", "-", "x", "y", "z"),
}
BOUNDS = re.compile(r"^\s*(\S+)\s+(\S+)\s+([xyz])lo\s+[xyz]hi", re.MULTILINE)
TILTS = re.compile(r"^\s*(\S+)\s+(\S+)\s+(\S+)\s+xy\s+xz\s+yz", re.MULTILINE)
VECTORS = re.compile(r"^\s*(\S+)\s+(\S+)\s+(\S+)\s+([abc])vec", re.MULTILINE)
ORIGIN = re.compile(r"^\s*(\S+)\s+(\S+)\s+(\S+)\s+abc\s+origin", re.MULTILINE)
COUNT = re.compile(r"^\s*(\d+)\s+atoms", re.MULTILINE)
ATOMS = re.compile(r"^[ \t]*Atoms[ \t]*(?:#[ \t]*([\w/]+))?[^\n]*\n", re.MULTILINE)


class LammpsData(Format):
    """A data file. Sizes are diameters; the units are in the first line if LAMMPS wrote the file."""

    name = "lammps_data"
    description = "LAMMPS data file"
    endings = (".data", ".lmp", ".lammps")

    def recognises(self, file: Path, head: str) -> bool:
        return bool(COUNT.search(head) and BOUNDS.search(head)) or bool(COUNT.search(head) and VECTORS.search(head))

    def read(self, file: Path, answers: Answers) -> Packing:
        text = whole_text(file)
        first, _, _ = text.partition("\n")
        section, count = ATOMS.search(text), COUNT.search(text)
        if section is None or count is None:
            raise damaged_file(file, "it has no section Atoms")
        lines = text[section.end() :].splitlines()
        rows = [line.partition("#")[0].split() for line in lines if line.strip()][: int(count[1])]
        style = section[1]
        names = answer_names(answers.columns) or STYLES.get(style or "sphere")
        if names is None or (style is None and answers.columns is None and not _may_be_spheres(rows)):
            what = f"atom style {style}, which has no grain sizes" if style else "atoms of an unnamed style"
            example = f"{len(rows[0])} columns of the section Atoms" if rows else "columns of the section Atoms"
            raise InputError(
                f"{file} has {what}: name the {example} with --columns, e.g. id,-,diameter,-,x,y,z, where - skips one"
            )
        try:
            values = same_length([[float(word) for word in row[: len(names)]] for row in rows])
        except ValueError as error:
            raise damaged_file(file, error) from None
        if len(values) != int(count[1]) or values.ndim != 2:
            raise damaged_file(file, f"it has {len(rows)} of {count[1]} atoms")
        columns, _ = GRAIN.columns(names, values, file)
        cell, origin = _cell_and_origin(text, file)
        units = re.search(r"units\s*=\s*(\w+)", first)
        metre, newton = units_of_style(units[1] if units else None)
        return dataclasses.replace(
            grains_from(columns, file), cell=cell, origin=origin, length_unit=metre, force_unit=newton
        )

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
    """True if rows of an unnamed style may be id, type, diameter, density, x, y, z, perhaps with image flags.

    In the styles of molecules with seven columns the third is the type, a whole number.
    """
    return bool(rows) and len(rows[0]) in (7, 10) and not all(row[2].isdigit() for row in rows if len(row) > 2)


def _cell_and_origin(text: str, file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read (cell, origin) from the header of a data file. Raises InputError if they are missing."""
    vectors = {found[4]: [float(found[k]) for k in (1, 2, 3)] for found in VECTORS.finditer(text)}
    if set(vectors) == {"a", "b", "c"}:
        origin = ORIGIN.search(text)
        corner = np.zeros(3) if origin is None else np.array([float(origin[k]) for k in (1, 2, 3)])
        return np.array([vectors[name] for name in "abc"]).T, corner
    bounds = {found[3]: (float(found[1]), float(found[2])) for found in BOUNDS.finditer(text)}
    if set(bounds) != {"x", "y", "z"}:
        raise damaged_file(file, "it has no box")
    low, high = (np.array([bounds[axis][k] for axis in "xyz"]) for k in (0, 1))
    tilts = TILTS.search(text)
    return triclinic(high - low, *([] if tilts is None else [float(tilts[k]) for k in (1, 2, 3)])), low


def standard_orientation(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotate a cell so that its first vector is along x and its second in the x-y plane; returns (cell, rotation).

    LAMMPS supports only such cells, with tilts of at most half an edge. With the QR decomposition H = Q R, the rotated
    cell is R with a positive diagonal.
    """
    orthogonal, upper = np.linalg.qr(cell)
    sign = np.where(np.diag(upper) < 0.0, -1.0, 1.0)
    rotated, rotation = upper * sign[:, None], (orthogonal * sign).T
    rotated[np.tril_indices(3, -1)] = 0.0
    for column, row in ((2, 1), (2, 0), (1, 0)):  # LAMMPS refuses a tilt above half an edge: choose an equivalent cell
        rotated[:, column] -= np.rint(rotated[row, column] / rotated[row, row]) * rotated[:, row]
    return rotated, rotation
