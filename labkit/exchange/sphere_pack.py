"""YADE's SpherePack text: a first line `##PERIODIC:: x y z` with the box, then x y z radius, perhaps a clump id."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from labkit.errors import InputError
from labkit.exchange.answers import Answers
from labkit.exchange.columns import is_number, same_length
from labkit.exchange.formats import Format, damaged_file, whole_text
from labkit.exchange.packing import RADIUS, Packing
from labkit.exchange.tables import TextTable
from labkit.grains.state import State
from labkit.io.atomic import write_text

MARK = "##PERIODIC::"


class SpherePack(Format):
    """Text written by SpherePack.save, or other columns below its first line, a header or --columns naming them.

    Its box is a cuboid with a corner at the origin; it has no contacts.
    """

    name = "sphere_pack"
    description = "text of YADE's SpherePack, with its periodic box"
    endings = (".spheres",)

    def recognises(self, file: Path, head: str) -> bool:
        return head.lstrip().startswith(MARK)

    def read(self, file: Path, answers: Answers) -> Packing:
        rows = [line.split() for line in whole_text(file).splitlines() if line.strip()]
        boxes = [words for words in rows if words[0].startswith("##PERIODIC")]
        rows = [words for words in rows if not words[0].startswith("#")]
        named = answers.columns is not None or not all(map(is_number, rows[0] if rows else []))
        try:
            box = np.array([float(word) for word in boxes[0][1:4]]) if boxes else None
            if named and box is not None and box.shape == (3,):
                return dataclasses.replace(TextTable().read(file, answers), cell=np.diag(box), origin=np.zeros(3))
            values = same_length([[float(word) for word in words[:5]] for words in rows])
        except ValueError as error:
            raise damaged_file(file, error) from None
        if values.ndim != 2 or values.shape[1] < 4 or (box is not None and box.shape != (3,)):
            raise damaged_file(file, "its rows are not x y z radius")
        packing = Packing(values[:, :3], values[:, 3], RADIUS)
        if box is not None:
            packing = Packing(values[:, :3], values[:, 3], RADIUS, cell=np.diag(box), origin=np.zeros(3))
        clumped = int((values[:, 4] >= 0).sum()) if values.shape[1] > 4 else 0
        return packing.noting(*[f"{clumped} grains are parts of clumps: they become separate grains"][:clumped])

    def write(self, state: State, file: Path) -> None:
        """Write the grains in metres. Raises InputError for a cell that is not a cuboid along the axes."""
        lengths = np.diag(state.cell)
        if np.abs(state.cell - np.diag(lengths)).max() > 1e-9 * lengths.max():
            raise InputError(f"{file}: a SpherePack has no sheared cell; choose --format lammps_data or ondem")
        lines = [" ".join([MARK, *map(repr, lengths.tolist())])]
        rows = np.column_stack([state.position, state.radius]).tolist()
        lines += [" ".join(map(repr, row)) for row in rows]
        write_text(file, "\n".join(lines) + "\n")
