"""Sorts contacts in the order of a State: smaller grain first, sorted by first grain, second grain and shift."""

from __future__ import annotations

import numpy as np


def is_reversed(pair: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return a mask (n,), True for contacts whose two grains must be exchanged for the order of a State.

    If a grain touches its own image, the shift decides.

    Args:
        pair: Indices of the two grains, (n, 2).
        shift: Periodic shift of the second grain, in cell vectors, (n, 3).
    """
    backwards, periodic = pair[:, 0] > pair[:, 1], pair[:, 0] == pair[:, 1]
    backwards[periodic] = np.sign(shift[periodic]) @ np.array([9, 3, 1]) < 0
    return backwards


def sort_contacts(pair: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sort contacts in the order of a State.

    Returns contact_grain (n, 2) and contact_shift (n, 3) of the State, the indices (n,) that sort the
    contacts and, in the new order, the sign (n, 1) of their history: -1 where the grains are exchanged.

    Args:
        pair: Indices of the two grains in any order, (n, 2).
        shift: Periodic shift of the second grain, in cell vectors, (n, 3).
    """
    backwards = is_reversed(pair, shift)
    shift = np.where(backwards.repeat(3).reshape(-1, 3), -shift, shift)
    most = np.int64(pair.max(initial=0) + 1)
    key = np.minimum(*pair.T) * most + np.maximum(*pair.T)
    order = np.argsort(key)
    ordered = key.take(order)
    if (ordered[1:] == ordered[:-1]).any():  # two grains touch across two sides of the cell
        order = np.lexsort((*shift.T, key))
    pair = np.stack(np.divmod(ordered, most), axis=1, dtype=np.int32, casting="same_kind")
    return pair, shift.take(order, axis=0).astype(np.int32), order, 1.0 - 2.0 * backwards.take(order)[:, None]
