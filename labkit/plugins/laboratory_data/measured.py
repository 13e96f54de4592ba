"""A measured test as its checks need it, and the words in which they name its numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from labkit.paths.path import Held, Path
from labkit.plugins.laboratory_data.table import LaboratoryColumns


@dataclasses.dataclass(frozen=True, eq=False)
class Measured:
    """A measured test, as the checks need it.

    Args:
        path: Path that repeats the test.
        table: Columns in the file.
        columns: Quantity -> (header, unit, sign) as the user gave them.
        values: Quantity -> values, SI units, compression positive, (n,).
        records: axial_strain (n,), stress (n, 3, 3), void_ratio (n,), volume (n,).
        void_ratio: Void ratio of the first row that the user gave.
        pore_pressure: Pore pressure that was subtracted from the stresses in the file, Pa, (n,) or 0.
    """

    path: Path
    table: LaboratoryColumns
    columns: Mapping[str, Sequence[str | None]]
    values: Mapping[str, np.ndarray]
    records: Mapping[str, np.ndarray]
    void_ratio: float | None
    pore_pressure: np.ndarray | float = 0.0

    def line(self, row: int | np.integer) -> int:
        """Return the number of the line of a row."""
        return int(self.table.lines[row])


def in_percent(strain: float) -> str:
    """Return a strain in words."""
    return f"{100.0 * strain:.4g} %"


def kilopascal(stress: float) -> str:
    """Return a stress (Pa) in words."""
    return f"{stress / 1e3:.4g} kPa"


def words(quantity: str) -> str:
    """Return the name of a quantity in words."""
    return quantity.replace("_", " ")


def held_by(path: Path) -> tuple[Held, ...]:
    """Return what a path holds, also without its pressure."""
    return path.held() if getattr(path, "pressure", 1.0) is not None else path.starting_at(1.0).held()
