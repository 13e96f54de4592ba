"""Contacts at one instant: the geometry and the forces that every statistic starts from."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Contacts:
    """The n physical contacts of one instant, each listed once.

    grain (n, 2) int: indices of the first and the second grain;
    normal (n, 3): unit vector from the first to the second grain;
    overlap (n,): penetration depth delta, m;
    normal_force (n,): N, compression positive;
    tangential_force (n, 3): on the first grain, N;
    rolling_moment (n, 3): on the first grain, N m.
    """

    grain: np.ndarray
    normal: np.ndarray
    overlap: np.ndarray
    normal_force: np.ndarray
    tangential_force: np.ndarray
    rolling_moment: np.ndarray

    def __len__(self):
        return len(self.overlap)

    def branch_length(self, radius):
        """Distance of the two centres, R_a + R_b - delta, shape (n,), m. `radius` (grain,) in m."""
        return radius[self.grain[:, 0]] + radius[self.grain[:, 1]] - self.overlap

    def force_on_first(self):
        """Contact force on the first grain, shape (n, 3), N; the second carries the opposite."""
        return self.tangential_force - self.normal_force[:, None] * self.normal


NO_CONTACTS = Contacts(
    np.zeros((0, 2), int), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
)


def branch_vectors(position, cell, grain, shift):
    """Vectors x_b + H s - x_a from the first to the second grain, shape (n, 3), m.

    position (grain, 3) m; cell (3, 3) with the cell vectors as columns, m; grain (n, 2);
    shift (n, 3): cell periods to add to the second grain.
    """
    return position[grain[:, 1]] + shift @ cell.T - position[grain[:, 0]]


def contacts_of(state):
    """The Contacts of a State, with the normal force of the scene's law, fn = kn delta (Eq. 1)."""
    grain = state.contact_grain
    branch = branch_vectors(state.position, state.cell, grain, state.contact_shift)
    distance = np.sqrt(np.einsum("ci,ci->c", branch, branch))
    radius_a, radius_b = state.radius[grain[:, 0]], state.radius[grain[:, 1]]
    overlap = radius_a + radius_b - distance
    return Contacts(
        grain=grain,
        normal=branch / distance[:, None],
        overlap=overlap,
        normal_force=state.scene.normal_stiffness(radius_a, radius_b) * overlap,
        tangential_force=state.tangential_force,
        rolling_moment=state.rolling_moment,
    )


def grain_diameters(radius, contacts):
    """Diameter of the grain on each side of each contact, shape (n, 2), m."""
    return 2.0 * radius[contacts.grain]


def contact_arms(radius, contacts):
    """|l| = R - delta/2 of the contact vector l on each side (Eq. 4), shape (n, 2), m."""
    return radius[contacts.grain] - 0.5 * contacts.overlap[:, None]


def contacts_per_grain(number_of_grains, contacts):
    """Number of contacts of each grain, shape (grain,)."""
    return np.bincount(contacts.grain.ravel(), minlength=number_of_grains)
