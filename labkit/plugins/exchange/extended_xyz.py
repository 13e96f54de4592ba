"""Extended XYZ files, of OVITO and ASE: grains with radii and velocities in a periodic cell, one frame or several."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from labkit.files.atomic import write_text
from labkit.plugins.exchange.columns import GRAIN, SKIP, grains_from, number_in, require_length
from labkit.plugins.exchange.formats import Format, damaged_file
from labkit.plugins.exchange.packing import Answers, Packing, answer_names, frame_number, require_count
from labkit.text.reading import MOST_COLUMNS, real, text_of, whole

if TYPE_CHECKING:
    from labkit.grains.state import State

PROPERTIES = "species:S:1:pos:R:3:radius:R:1:id:I:1"
VELOCITY = ":velo:R:3"
KEY = re.compile(r'\b([A-Za-z_]{1,40})=(?:"([^"]*)"|(\S+))')


class ExtendedXyz(Format):
    """An extended XYZ file: `Lattice` has the three cell vectors one after another, `Properties` names the columns."""

    name = "extended_xyz"
    description = "extended XYZ (OVITO, ASE), .xyz or .extxyz"
    endings: ClassVar[tuple[str, ...]] = (".xyz", ".extxyz")

    def recognises(self, file: Path, head: str) -> bool:
        first, _, rest = head.partition("\n")
        second = rest.partition("\n")[0]
        return first.strip().isdecimal() and ("Properties=" in second or "Lattice=" in second)

    def read(self, file: Path, answers: Answers) -> Packing:
        lines = text_of(file).rstrip().split("\n")
        try:
            starts = _starts(lines, file)
            number, notes = frame_number(len(starts), answers, file)
            keys = {key: quoted or plain for key, quoted, plain in KEY.findall(lines[starts[number] + 1])}
            names = answer_names(answers.columns) or _names(keys.get("Properties", "species:S:1:pos:R:3"))
            rows = [line.split() for line in lines[starts[number] + 2 : [*starts[1:], len(lines)][number]]]
            require_length(rows, len(names))
            values = np.array([[number_in(*cell) for cell in zip(row, names, strict=True)] for row in rows])
            cell, origin = _numbers(keys, "Lattice", 9), _numbers(keys, "Origin", 3)
            at = {"time": real(keys["Time"])} if "Time" in keys else {}
            columns, _ = GRAIN.columns(names, values.reshape(len(rows), len(names)), file)
            packing = grains_from(columns, file)
            if cell is not None:
                cell, origin = cell.reshape(3, 3).T, np.zeros(3) if origin is None else origin
        except (ValueError, IndexError, OverflowError) as error:
            raise damaged_file(file, error) from None
        unit = 1.0 if keys.get("units", "").lower() == "si" else None
        packing = dataclasses.replace(packing, cell=cell, origin=origin, length_unit=unit, at=at)
        open_ = [axis for axis, flag in zip("xyz", keys.get("pbc", "T T T").split(), strict=False) if flag not in "T1"]
        return packing.with_notes(*notes, *([f"the box is not periodic in {', '.join(open_)}"] if open_ else []))

    def write_frames(self, states: Iterable[State], file: Path) -> None:
        """Write a frame for each state: grains in m, as they are, not wrapped, and velocities unless all are zero."""
        write_text(file, "".join(map(_frame, states)))


def _numbers(keys: Mapping[str, str], key: str, count: int) -> np.ndarray | None:
    """Return the numbers of a key; None if it is missing. Raises ValueError for another count."""
    if key not in keys:
        return None
    numbers = np.array([real(word) for word in keys[key].split()])
    if len(numbers) != count:
        raise ValueError(f"{key} has {len(numbers)} numbers, not {count}")
    return numbers


def _starts(lines: list[str], file: Path) -> list[int]:
    """Return the indices of the lines with the number of grains. Raises InputError if a number contradicts its rows."""
    starts, at = [], 0
    while at < len(lines):
        starts.append(at)
        count = whole(lines[at])
        rows = next((k for k, line in enumerate(lines[at + 2 :]) if len(line.split()) < 2), len(lines) - at - 2)
        require_count(file, count, rows, "grains")
        at += count + 2
    return starts


def _names(properties: str) -> list[str]:
    """Return the names of the columns in `Properties`: name, type and number of columns in turn."""
    words, names = properties.split(":"), list[str]()
    if len(words) % 3 or not all(0 < whole(count) <= MOST_COLUMNS for count in words[2::3]):
        raise ValueError("Properties does not consist of names, types and numbers of columns")
    for name, _, count in zip(words[::3], words[1::3], words[2::3], strict=True):
        axes = ("x", "y", "z") if name.lower() in ("pos", "position") else (SKIP,) * whole(count)
        names += [name] if count == "1" else axes
    return names


def _frame(state: State) -> str:
    """Return one frame. The species X is no chemical element, as ASE writes it."""
    moves = bool(state.velocity.any())
    lattice = " ".join(map(repr, state.cell.T.ravel().tolist()))
    properties = f"Properties={PROPERTIES}{VELOCITY * moves}"
    head = f'Lattice="{lattice}" Origin="0 0 0" pbc="T T T" {properties} units=SI Time={state.time!r}'
    columns = [state.position, state.radius, *([state.velocity] if moves else [])]
    rows = [
        " ".join(["X", *map(repr, row[:4]), str(number), *map(repr, row[4:])])
        for number, row in enumerate(np.column_stack(columns).tolist(), 1)
    ]
    return "\n".join([str(len(rows)), head, *rows, ""])
