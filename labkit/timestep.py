"""The stability limit of the explicit integration."""

from __future__ import annotations

import numpy as np

from labkit.errors import PhysicsError
from labkit.micro.contacts import contacts_of


def critical_time_step(state):
    """A time step below which the undamped integration of this state is stable, s.

    2/omega with omega^2 <= 2 max over grains of the largest eigenvalue of M^-1 K_g, K_g (6 x 6) the
    stiffness that one grain feels when all others are held: the energy k (u_a - u_b)^2/2 of a contact is
    at most k (u_a^2 + u_b^2). Translation and rotation, tangential stiffness and rolling stiffness count.
    inf without contacts.
    """
    contacts = contacts_of(state)
    if len(contacts) == 0:
        return np.inf
    scene, radius = state.scene, state.radius
    a, b = radius[contacts.grain[:, 0]], radius[contacts.grain[:, 1]]
    kn, kt = scene.normal_stiffness(a, b), scene.tangential_stiffness(a, b)
    kr = kt * a * b / 4 if scene.rolling_friction > 0 else np.zeros_like(kt)
    n = contacts.normal
    nn = n[:, :, None] * n[:, None, :]
    tangent = np.eye(3) - nn
    cross = np.zeros_like(nn)  # the matrix of n x
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -n[:, 2], n[:, 1], -n[:, 0]
    cross -= cross.transpose(0, 2, 1)
    K = np.zeros((state.number_of_grains, 6, 6))
    for side, sign in ((0, 1.0), (1, -1.0)):
        grain = contacts.grain[:, side]
        R = radius[grain][:, None, None]
        coupling = sign * kt[:, None, None] * R * cross
        np.add.at(K[:, :3, :3], grain, kn[:, None, None] * nn + kt[:, None, None] * tangent)
        np.add.at(K[:, 3:, 3:], grain, (kt[:, None, None] * R**2 + kr[:, None, None]) * tangent)
        np.add.at(K[:, 3:, :3], grain, coupling)
        np.add.at(K[:, :3, 3:], grain, coupling.transpose(0, 2, 1))
    inertia = np.stack([scene.mass(radius)] * 3 + [scene.moment_of_inertia(radius)] * 3, axis=1)
    scaling = 1.0 / np.sqrt(inertia)
    largest = np.linalg.eigvalsh(K * scaling[:, :, None] * scaling[:, None, :])[:, -1].max()
    return float(2.0 / np.sqrt(2.0 * largest))


def require_stable(state):
    """Raises PhysicsError when the time step is beyond the stability limit of the state."""
    limit = critical_time_step(state)
    if state.time_step > limit:
        raise PhysicsError(
            f"the time step {state.time_step:.3g} s is beyond the stable {limit:.3g} s: "
            f"lower time_step_factor from {state.scene.time_step_factor:g}"
        )
