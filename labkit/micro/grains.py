"""Quantities of each grain derived from its contacts: sums, means, fabric and stress, one row per grain."""

from __future__ import annotations

import numpy as np

from labkit.micro.snapshot import Snapshot, contact_dyads, contacts_per_grain


def sum_per_grain(snapshot: Snapshot, values: np.ndarray) -> np.ndarray:
    """Return the sum of values (n, 2, ...), one per contact side, over the sides of each grain, shape (grain, ...)."""
    side = snapshot.contacts.grain.ravel()
    shape = np.shape(values)[2:]
    columns = np.reshape(values, (len(side), int(np.prod(shape)))).T
    sums = [np.bincount(side, column, snapshot.number_of_grains) for column in columns]
    return np.stack(sums, axis=1).reshape(snapshot.number_of_grains, *shape)


def mean_per_grain(snapshot: Snapshot, values: np.ndarray) -> np.ndarray:
    """Return the mean of values (n, 2, ...), one per contact side, over the sides of each grain, shape (grain, ...).

    The mean is zero for a grain without contacts.
    """
    sums = sum_per_grain(snapshot, values)
    number = np.maximum(contacts_per_grain(snapshot), 1)
    return sums / number.reshape(-1, *(1,) * (sums.ndim - 1))


def grain_fabric(snapshot: Snapshot) -> np.ndarray:
    """Return the fabric tensor <n n> of each grain, shape (grain, 3, 3), trace 1; zero for a grain without contacts."""
    normal = snapshot.contacts.normal
    dyads = normal[:, :, None] * normal[:, None, :]
    return mean_per_grain(snapshot, np.stack([dyads, dyads], axis=1))


def grain_stress(snapshot: Snapshot) -> np.ndarray:
    """Return the stress of each grain, -(1/v) sum of l (x) f with v = 4/3 pi R^3, shape (grain, 3, 3), in Pa.

    The sum runs over the contacts of the grain; compression is positive. Love's stress (Eq. 4) is the sum of v times
    the grain stress, divided by the cell volume.
    """
    volume = 4.0 / 3.0 * np.pi * snapshot.radius**3
    return -sum_per_grain(snapshot, contact_dyads(snapshot)) / volume[:, None, None]


def over_mean(values: np.ndarray, of: np.ndarray) -> np.ndarray:
    """Return the values divided by the mean of `of`; zero if `of` is empty or its mean is not positive."""
    mean = of.mean() if len(of) else 0.0
    return values / mean if mean > 0.0 else np.zeros_like(values)
