"""Packing: what a file of another program says about grains, box and contacts, before anything is added to it."""

from __future__ import annotations

import dataclasses

import numpy as np

RADIUS, DIAMETER = "radius", "diameter"
COMPRESSION, TENSION = "compression", "tension"
FIRST, SECOND = "first", "second"


@dataclasses.dataclass(frozen=True)
class ContactList:
    """Contacts as listed in a file, in the units of the file. None: the file does not say.

    grain (n, 2): ids of the two grains. Either `normal_force` (n,) with `positive`, the sign that means compression
    (`compression` or `tension`), or `force` (n, 3), the whole contact force. tangential_force (n, 3). The vectors act
    on the grain `acts_on` (`first` or `second`). overlap (n,) is only compared with that of the grains.
    force_unit: N, None if it is that of the file of grains.
    """

    grain: np.ndarray
    normal_force: np.ndarray | None = None
    positive: str | None = None
    tangential_force: np.ndarray | None = None
    force: np.ndarray | None = None
    acts_on: str | None = None
    overlap: np.ndarray | None = None
    force_unit: float | None = None

    def __len__(self) -> int:
        return len(self.grain)

    def rows(self, index: np.ndarray) -> ContactList:
        """The contacts with these numbers, or where this mask is true."""
        arrays = {name: values[index] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return dataclasses.replace(self, **arrays)

    @property
    def has_forces(self) -> bool:
        """True if the list contains normal forces or force vectors."""
        return self.normal_force is not None or self.force is not None


@dataclasses.dataclass(frozen=True)
class Packing:
    """Grains, box and contacts of a file, in the units of the file. None: the file does not say.

    position (n, 3): grain centres; size (n,), whose meaning is `size_is` (`radius` or `diameter`); id (n,): by which
    contacts refer to the grains; cell (3, 3): cell vectors as columns; origin (3,): corner of the cell, None if the
    file gives only lengths; contacts; length_unit: m; force_unit: N; notes: what the reader left out or assumed.
    """

    position: np.ndarray
    size: np.ndarray | None = None
    size_is: str | None = None
    id: np.ndarray | None = None
    cell: np.ndarray | None = None
    origin: np.ndarray | None = None
    contacts: ContactList | None = None
    length_unit: float | None = None
    force_unit: float | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.position)

    def noting(self, *notes: str) -> Packing:
        """A copy with further notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))


def triclinic(lengths: np.ndarray, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0) -> np.ndarray:
    """Cell of LAMMPS with edge lengths (3,) and tilts: columns (lx, 0, 0), (xy, ly, 0), (xz, yz, lz)."""
    cell = np.diag(np.asarray(lengths, dtype=float))
    cell[0, 1], cell[0, 2], cell[1, 2] = xy, xz, yz
    return cell
