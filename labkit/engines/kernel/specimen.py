"""The whole specimen, as an engine loads and returns it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from labkit.engines.kernel.host import find_touching
from labkit.engines.kernel.packing import History
from labkit.engines.sorting import sort_contacts
from labkit.errors import InputError
from labkit.grains.columns import overlaps
from labkit.grains.laws.parts import columns_in
from labkit.grains.state import State
from labkit.grains.valid import require_fitting

Kinematics: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # position, velocity, spin: (grain, 3), in SI units


class Scale(NamedTuple):
    """Number of grains, mean and largest diameter (m), and the largest gap that a contact crosses (m)."""

    grains: int
    mean_diameter: float
    largest_diameter: float
    reach: float

    @classmethod
    def of(cls, state: State) -> Scale:
        """Return the scale of the grains of a State."""
        radius = state.radius
        return cls(len(radius), 2.0 * radius.mean(), 2.0 * radius.max(), state.scene.contact_law.reach(state))


class Pairs(NamedTuple):
    """Pairs of grains: indices (n, 2), periodic shift of the second grain (n, 3), history (n, k)."""

    grain: np.ndarray
    shift: np.ndarray
    rows: np.ndarray


def require_loadable(state: State) -> None:
    """Raise InputError for a state that is not one of grains in a cell, or whose law does not support clumps."""
    try:
        require_fitting(state)
    except ValueError as error:
        raise InputError(f"the state is not one of grains in a cell: {error}") from None
    if state.clumps is not None and state.scene.contact_law.far:
        problem, allowed = "acts across a gap, which clumps do not support", "a law without cohesion or bonds"
        raise InputError(problem, field="law", value=state.scene.law, allowed=allowed, quoted=True)


def history_of(state: State, columns: Mapping[str, Any]) -> History:
    """Return the contact history of a state, with the columns of the parts that act in the scene."""
    history = state.history_columns
    if columns.keys() - history.keys():
        history = state.scene.contact_law.history_at(overlaps(state), history)
    rows = np.zeros((len(state.contact_grain), sum(column.size for column in columns.values())))
    for name, values in columns_in(rows, columns).items():
        values[:] = history[name]
    return History(
        np.array(state.contact_grain.T, np.int32, order="C"),  # a copy, whose indices nobody changes any more
        np.ascontiguousarray(state.contact_shift, np.int32),
        rows,
        np.concatenate([np.full(column.size, column.odd) for column in columns.values()] or [np.zeros(0, bool)]),
        np.arange(state.number_of_grains),
    )


def contacts_among(
    pairs: Pairs, position: np.ndarray, radius: np.ndarray, cell: np.ndarray, columns: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the contacts among some pairs, sorted as `sort_contacts` does, with indices (n,) of pairs.

    Args:
        pairs: The pairs.
        position: Positions, (grain, 3), in m.
        radius: Radii, (grain,), in m.
        cell: Cell vectors as columns, (3, 3), in m.
        columns: Columns of history of which some join two grains even across a gap; empty if none does.
    """
    chosen = find_touching(pairs.grain, pairs.shift, position, radius, cell)
    if columns:
        history = columns_in(pairs.rows, columns)
        joined = [history[name] != 0.0 for name, column in columns.items() if column.joins]
        chosen = np.union1d(chosen, np.flatnonzero(np.any(joined, axis=0)))
    grain, shift, order, sign = sort_contacts(pairs.grain.take(chosen, 0), pairs.shift.take(chosen, 0))
    return grain, shift, chosen[order], sign
