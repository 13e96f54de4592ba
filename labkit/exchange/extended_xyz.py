"""Extended XYZ files, for OVITO and ASE: grains with radii and velocities in a periodic cell, in SI units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from labkit.exchange.formats import Format
from labkit.io.atomic import write_text

if TYPE_CHECKING:
    from labkit.grains.state import State

PROPERTIES = "species:S:1:pos:R:3:radius:R:1:id:I:1:velo:R:3"


class ExtendedXyz(Format):
    """An extended XYZ file, which labkit only writes; `Lattice` has the three cell vectors one after another."""

    name = "extended_xyz"
    description = "extended XYZ (OVITO, ASE), .xyz or .extxyz"
    endings: ClassVar[tuple[str, ...]] = (".xyz", ".extxyz")

    def write(self, state: State, file: Path) -> None:
        """Write one frame with the grains, in m and m/s, as they are, not wrapped into the cell."""
        lattice = " ".join(map(repr, state.cell.T.ravel().tolist()))
        head = f'Lattice="{lattice}" Origin="0 0 0" pbc="T T T" Properties={PROPERTIES} units=SI Time={state.time!r}'
        rows = np.column_stack([state.position, state.radius, state.velocity]).tolist()
        lines = [  # X is no chemical element, as ASE writes it
            f"X {' '.join(map(repr, row[:4]))} {number} {' '.join(map(repr, row[4:]))}"
            for number, row in enumerate(rows, 1)
        ]
        write_text(file, "\n".join([str(len(rows)), head, *lines]) + "\n")
