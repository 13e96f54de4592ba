"""ContactList: the contacts that a file of another program lists, in the units of the file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class ContactList:
    """Contacts as listed in a file, in the units of the file. A field is None if the file does not specify it.

    The forces are either `normal_force` and `tangential_force`, or `force`.

    Args:
        grain: Ids of the two grains, (n, 2).
        normal_force: Normal force, (n,).
        positive: Meaning of a positive normal force, "compression" or "tension".
        force: Whole contact force, (n, 3).
        tangential_force: Tangential force, (n, 3).
        acts_on: Grain on which the vectors act, "first" or "second".
        overlap: Overlap, (n,), which is only compared with the overlap of the grains.
        overlap_unit: Unit of the overlap, m; None if it is the same as in the file of grains.
        point: Contact points, (n, 3), in the frame of the grain centres; then the grains may have any shape.
        point_unit: Unit of the contact points, m; None if it is the same as in the file of grains.
        normal: Vectors along the contact normals, (n, 3), of any length and sign; used with contact points.
        force_unit: Unit of force, N; None if it is the same as in the file of grains.
        at: Instant of the contacts, `step` or `time` -> number.
        notes: What the reader of the file omitted or assumed.
    """

    grain: np.ndarray
    normal_force: np.ndarray | None = None
    positive: str | None = None
    tangential_force: np.ndarray | None = None
    force: np.ndarray | None = None
    acts_on: str | None = None
    overlap: np.ndarray | None = None
    overlap_unit: float | None = None
    point: np.ndarray | None = None
    point_unit: float | None = None
    normal: np.ndarray | None = None
    force_unit: float | None = None
    at: Mapping[str, float] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.grain)

    def rows(self, index: np.ndarray) -> ContactList:
        """Return the contacts with these numbers, or those for which a mask is true."""
        arrays = {name: values[index] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return dataclasses.replace(self, **arrays)

    @property
    def has_forces(self) -> bool:
        """True if the list contains normal forces or force vectors."""
        return self.normal_force is not None or self.force is not None
