"""Contact history as columns of a State and of files; the parts of contact laws declare them (labkit.laws.Column)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from labkit.files.hashes import values_of
from labkit.files.schema import STATE
from labkit.grains.laws import Column
from labkit.grains.scene import Scene
from labkit.micro.snapshot import branch_vectors

if TYPE_CHECKING:
    import netCDF4

    from labkit.grains.state import State


def history_fields(
    declared: Mapping[str, Column], arrays: Mapping[str, np.ndarray], contacts: int
) -> dict[str, object]:
    """Return the fields of a State that contain the contact history; unknown values are 0.

    Args:
        declared: The columns of the contact law: name -> Column.
        arrays: Columns of the parts that act in the scene: name -> values.
        contacts: Number of contacts.
    """
    force, moment = (np.zeros((contacts, 3)) for _ in range(2))
    columns = {name: column.zeros(contacts) for name, column in declared.items()}
    fields = {"tangential_force": force, "rolling_moment": moment} | columns | dict(arrays)
    return {name: fields.pop(name) for name in ("tangential_force", "rolling_moment")} | {"columns": fields}


def read_columns(group: netCDF4.Dataset, rows: slice, scene: Scene) -> dict[str, np.ndarray]:
    """Read the history columns that a scene's contact law declares besides tangential force and rolling moment."""
    names = [name for name in scene.contact_law.columns if name not in STATE and name in group.variables]
    return {name: values_of(group[name], rows).astype(float) for name in names}


def overlaps(state: State) -> np.ndarray:
    """Return the overlaps of the contacts of a State, (contact,), in m."""
    branch = branch_vectors(state.position, state.cell, state.contact_grain, state.contact_shift)
    return state.radius.take(state.contact_grain).sum(axis=1) - np.linalg.norm(branch, axis=1)
