"""What the contacts of each grain say of it: numbers, means and stress, a row per grain."""

from __future__ import annotations

import numpy as np

from labkit.micro.contacts import contact_arms, contacts_per_grain


def sum_per_grain(contacts, values, number_of_grains):
    """Sum over the contact sides of each grain, shape (grain, ...). `values` (n, 2, ...): of each side."""
    side = contacts.grain.ravel()
    shape = np.shape(values)[2:]
    columns = np.reshape(values, (len(side), int(np.prod(shape)))).T
    sums = [np.bincount(side, column, number_of_grains) for column in columns]
    return np.stack(sums, axis=1).reshape(number_of_grains, *shape)


def mean_per_grain(contacts, values, number_of_grains):
    """Mean over the contact sides of each grain, shape (grain, ...), zero for a grain without contacts."""
    sums = sum_per_grain(contacts, values, number_of_grains)
    number = np.maximum(contacts_per_grain(number_of_grains, contacts), 1)
    return sums / number.reshape(-1, *(1,) * (sums.ndim - 1))


def grain_fabric(contacts, number_of_grains):
    """<n n> over the contacts of each grain, shape (grain, 3, 3), trace 1; zero for a grain without contacts."""
    dyads = contacts.normal[:, :, None] * contacts.normal[:, None, :]
    return mean_per_grain(contacts, np.stack([dyads, dyads], axis=1), number_of_grains)


def grain_stress(contacts, radius):
    """-(1/v) sum of l (x) f over the contacts of each grain, v = 4/3 pi R^3, shape (grain, 3, 3), Pa.

    Love's stress (Eq. 4) is the sum of v times this over the volume of the cell. Compression positive; `radius`
    (grain,) m.
    """
    arm = contact_arms(radius, contacts)[:, :, None, None]
    dyads = contacts.normal[:, :, None] * contacts.force_on_first()[:, None, :]  # equal on both sides: -n (x) -f
    volume = 4.0 / 3.0 * np.pi * radius**3
    return -sum_per_grain(contacts, arm * dyads[:, None], len(radius)) / volume[:, None, None]
