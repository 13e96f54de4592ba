"""The history of contacts as columns of a State and of files; the parts of laws declare them (labkit.laws.Column)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np

from labkit.grains.laws import Column
from labkit.grains.scene import Scene
from labkit.io.hashes import values_of
from labkit.io.schema import STATE
from labkit.micro.snapshot import branch_vectors

if TYPE_CHECKING:
    from labkit.grains.state import State


def history_fields(declared: Mapping[str, Column], known: Mapping[str, np.ndarray], contacts: int) -> dict[str, Any]:
    """Fields of a State with the history of contacts, 0 where it is not known.

    Args:
        declared: The columns of the contact law: name -> Column.
        known: Columns of the parts that act in the scene: name -> values.
        contacts: Number of contacts.
    """
    force, moment = (np.zeros((contacts, 3)) for _ in range(2))
    columns = {name: column.zeros(contacts) for name, column in declared.items()}
    fields = {"tangential_force": force, "rolling_moment": moment} | columns | dict(known)
    return {name: fields.pop(name) for name in ("tangential_force", "rolling_moment")} | {"columns": fields}


def read_columns(group: netCDF4.Dataset, rows: slice, scene: Scene) -> dict[str, np.ndarray]:
    """Read those columns of history that the law of a scene keeps beside tangential force and rolling moment."""
    names = [name for name in scene.contact_law.columns if name not in STATE and name in group.variables]
    return {name: values_of(group[name], rows).astype(float) for name in names}


def overlaps(state: State) -> np.ndarray:
    """Overlaps of the contacts of a State, (contact,), m."""
    branch = branch_vectors(state.position, state.cell, state.contact_grain, state.contact_shift)
    return state.radius.take(state.contact_grain).sum(axis=1) - np.linalg.norm(branch, axis=1)
