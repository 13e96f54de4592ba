"""Converts the contacts of a State to neighbour lists and back, on the host."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from labkit.engines.contacts import is_reversed, sort_contacts
from labkit.engines.cuda.arrays import HISTORY
from labkit.engines.cuda.device import SLICE
from labkit.engines.kernel.arranging import touching
from labkit.errors import PhysicsError
from labkit.grains.state import State


def entries(count: np.ndarray, slice_first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return grain and slot of each entry, (n,) each, sorted by grain.

    Args:
        count: Number of neighbours of each grain, (grain,).
        slice_first: First entry of each slice, (slice,).
    """
    grain = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(grain)) - np.repeat(np.cumsum(count) - count, count)
    return grain, slice_first[grain // SLICE] + SLICE * k + grain % SLICE


def lists_of(state: State, order: np.ndarray, first: int) -> dict[str, np.ndarray]:
    """Return the contacts of a State as arrays of Lists: those of its grains, and those of entries, (..., n).

    Args:
        state: State with the contacts.
        order: Index in the State of each grain on the device, (grain,).
        first: First grain of the State on the device.
    """
    place = np.argsort(order)
    number, shift = state.contact_grain, state.contact_shift
    is_first = ~is_reversed(number, shift)
    history = np.hstack([state.tangential_force, state.rolling_moment]) * np.where(is_first, 1.0, -1.0)[:, None]
    own, other = np.concatenate([number, number[:, ::-1]]).T
    partner = np.where(np.concatenate([is_first, ~is_first]), place[other] + first, ~(place[other] + first))
    shifts = np.concatenate([shift, -shift])
    by = np.lexsort((*shifts.T, other, place[own]))
    count = np.bincount(place[own], minlength=len(order))
    longest = np.pad(count, (0, -len(count) % SLICE)).reshape(-1, SLICE).max(axis=1) * SLICE
    slice_first = np.cumsum(longest) - longest
    _, slot = entries(count, slice_first)
    lists = {"count": count, "slice_first": slice_first}
    rows = {"partner": partner[None], "shift": shifts.T, "history": np.concatenate([history, history]).T}
    for name, values in rows.items():
        lists[name] = np.zeros((len(values), int(longest.sum())), values.dtype)
        lists[name][:, slot] = values[:, by]
    return lists


def state_from_lists(brief: State, order: np.ndarray, first: int, arrays: Mapping[str, np.ndarray]) -> State:
    """Return the State that was read from the device. Raises PhysicsError if it contains NaN.

    Args:
        brief: The State without the arrays that the device holds, and with its former ledger.
        order: Index in the State of each grain on the device, (grain,).
        first: First grain of the State on the device.
        arrays: Arrays of States, DeviceGrains and Lists by name, (k, n).
    """
    ledger = brief.ledger.plus(*arrays["energies"].sum(axis=1))
    if not np.isfinite(ledger.cell_work):
        raise PhysicsError(f"forces became NaN: the time step {brief.time_step:.3g} s is too large")
    kinematics = np.empty((3, len(order), 3))
    kinematics[:, order] = arrays["position"].T, arrays["velocity"].T, arrays["spin"].T
    grain, slot = entries(arrays["count"][0], arrays["slice_first"][0])
    partner = arrays["partner"][0, slot] - first
    of_first = partner >= 0
    grain, slot, partner = grain[of_first], slot[of_first], partner[of_first]
    pair, shift = order[np.stack([grain, partner], axis=1)], arrays["shift"][:, slot].T.astype(np.int32)
    kept = touching(pair, shift, kinematics[0], brief.radius, brief.cell)
    contact_grain, contact_shift, by, _ = sort_contacts(pair[kept], shift[kept])
    history = arrays["history"][:, slot[kept][by]].T.astype(float)
    return brief.replace(
        position=kinematics[0],
        velocity=kinematics[1],
        angular_velocity=kinematics[2],
        contact_grain=contact_grain,
        contact_shift=contact_shift,
        tangential_force=history[:, :3],
        rolling_moment=history[:, 3:HISTORY],
        ledger=ledger,
    )
