"""Neighbour lists of the contacts of a State, and the contacts of a State from neighbour lists, on the host."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from labkit.engines.cuda.arrays import HISTORY
from labkit.engines.cuda.device import SLICE
from labkit.grains.state import State


@dataclasses.dataclass(frozen=True)
class Listing:
    """The neighbour lists of one State, with its grains in any order, each counted from zero.

    grain, slot, partner (n,): grain of each entry, its place in the region, and the other grain; is_first (n,): True if
    `grain` is the first grain of the contact; shift (n, 3): period of the partner relative to that of the grain;
    history (n, HISTORY): on the first grain.
    """

    grain: np.ndarray
    slot: np.ndarray
    partner: np.ndarray
    is_first: np.ndarray
    shift: np.ndarray
    history: np.ndarray


def entries(count: np.ndarray, slice_first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grain and slot of each entry (n,), by grain, from the number of neighbours per grain and the starts of slices."""
    grain = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(grain)) - np.repeat(np.cumsum(count) - count, count)
    return grain, slice_first[grain // SLICE] + SLICE * k + grain % SLICE


def slices(count: np.ndarray) -> tuple[np.ndarray, int]:
    """First entry of each slice, and the number of all entries with those that fill up slices."""
    longest = np.pad(count, (0, -len(count) % SLICE)).reshape(-1, SLICE).max(axis=1) * SLICE
    return np.cumsum(longest) - longest, int(longest.sum())


def positive(shift: np.ndarray) -> np.ndarray:
    """True for shifts (n, 3) of the second grain of a contact of a grain with its own image, False for the first."""
    return np.sign(shift) @ np.array([9, 3, 1]) > 0


def spread(values: np.ndarray, slot: np.ndarray, room: int) -> np.ndarray:
    """Values (..., n) in their slots, and zeros elsewhere, (..., room)."""
    result = np.zeros((*values.shape[:-1], room), values.dtype)
    result[..., slot] = values
    return result


def listing_of(state: State, order: np.ndarray) -> tuple[Listing, np.ndarray, np.ndarray, int]:
    """The Listing of the contacts of a State, the entries of each grain, the starts of slices, and the room needed.

    order (grain,): index in the State of each grain.
    """
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    number, shift = state.contact_grain, state.contact_shift
    first = (number[:, 0] < number[:, 1]) | ((number[:, 0] == number[:, 1]) & positive(shift))
    history = np.hstack([state.tangential_force, state.rolling_moment]) * np.where(first, 1.0, -1.0)[:, None]
    own, other = np.concatenate([number, number[:, ::-1]]).T
    is_first = np.concatenate([first, ~first])
    shifts, both = np.concatenate([shift, -shift]), np.concatenate([history, history])
    by = np.lexsort((*shifts.T, other, place[own]))
    count = np.bincount(place[own], minlength=len(order))
    slice_first, room = slices(count)
    grain, slot = entries(count, slice_first)
    return Listing(grain, slot, place[other[by]], is_first[by], shifts[by], both[by]), count, slice_first, room


def listed(arrays: Mapping[str, np.ndarray], first: int) -> Listing:
    """The Listing in the arrays (k, n) of one State on the device, those of Lists by name; first: its first grain."""
    grain, slot, is_first, partner = list_neighbours(arrays, first)
    shift, history = arrays["shift"][:, slot].T, arrays["history"][:, slot].T.astype(float)
    return Listing(grain, slot, partner, is_first, shift, history)


def list_neighbours(
    arrays: Mapping[str, np.ndarray], first: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """grain, slot, is_first and partner of a Listing, from count, slice_first and partner of one State."""
    grain, slot = entries(arrays["count"][0], arrays["slice_first"][0])
    partner = arrays["partner"][0, slot]
    is_first = partner >= 0
    return grain, slot, is_first, np.where(is_first, partner, ~partner) - first


def contacts_from_lists(
    listing: Listing, order: np.ndarray, position: np.ndarray, radius: np.ndarray, cell: np.ndarray
) -> dict[str, np.ndarray]:
    """The contact arrays of a State: the entries of first grains that overlap or touch their partners, sorted.

    order (grain,): index in the State of each grain; position (grain, 3), radius (grain,): in the order of the State.
    """
    number = np.stack([order[listing.grain], order[listing.partner]], axis=1)
    branch = position[number[:, 1]] + listing.shift @ cell.T - position[number[:, 0]]
    overlap = radius[number].sum(axis=1) - np.sqrt(np.einsum("ci,ci->c", branch, branch))
    kept = np.flatnonzero(listing.is_first & (overlap >= 0.0))
    kept = kept[np.lexsort((*listing.shift[kept].T, number[kept, 1], number[kept, 0]))]
    return {
        "contact_grain": number[kept].astype(np.int32),
        "contact_shift": listing.shift[kept].astype(np.int32),
        "tangential_force": listing.history[kept, :3],
        "rolling_moment": listing.history[kept, 3:HISTORY],
    }
