"""Packing: grains, box and contacts of another program's file, before anything is added."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

RADIUS, DIAMETER = "radius", "diameter"
COMPRESSION, TENSION = "compression", "tension"
FIRST, SECOND = "first", "second"


@dataclasses.dataclass(frozen=True)
class ContactList:
    """Contacts as listed in a file, in the units of the file. A field is None if the file does not specify it.

    The forces are either `normal_force` and `tangential_force`, or `force`.

    Args:
        grain: Ids of the two grains, (n, 2).
        normal_force: Normal force, (n,).
        positive: What a positive normal force means, "compression" or "tension".
        force: Whole contact force, (n, 3).
        tangential_force: Tangential force, (n, 3).
        acts_on: Grain on which the vectors act, "first" or "second".
        overlap: Overlap, (n,), which is only compared with that of the grains.
        force_unit: Unit of force, N; None if it is that of the file of grains.
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
        """Return the contacts with these numbers, or where this mask is true."""
        arrays = {name: values[index] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return dataclasses.replace(self, **arrays)

    @property
    def has_forces(self) -> bool:
        """True if the list contains normal forces or force vectors."""
        return self.normal_force is not None or self.force is not None


@dataclasses.dataclass(frozen=True)
class Packing:
    """Grains, box and contacts of a file, in the units of the file. A field is None if the file does not specify it.

    Args:
        position: Grain centres, (n, 3).
        size: Sizes, (n,).
        size_is: Meaning of the sizes, "radius" or "diameter".
        id: Ids by which contacts refer to the grains, (n,).
        cell: Cell vectors as columns, (3, 3).
        origin: Corner of the cell, (3,); None if the file gives only lengths.
        contacts: The contacts.
        length_unit: Unit of length, m.
        force_unit: Unit of force, N.
        notes: What the reader omitted or assumed.
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
        """Return a copy with further notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))


def triclinic(lengths: np.ndarray, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0) -> np.ndarray:
    """Return LAMMPS's cell with edge lengths (3,) and tilts: columns (lx, 0, 0), (xy, ly, 0), (xz, yz, lz)."""
    cell = np.diag(np.asarray(lengths, dtype=float))
    cell[0, 1], cell[0, 2], cell[1, 2] = xy, xz, yz
    return cell


def stated_material(words: Sequence[str]) -> str:
    """The note on the material that a file states, names and numbers in turn, which labkit does not take over."""
    pairs = [f"{name} {value}" for name, value in zip(words[::2], words[1::2], strict=False)]
    return f"the file states {', '.join(pairs)}: not used, give the material with --density, --friction and others"
