"""The stability limit of the explicit time integration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from labkit.bodies.clumps import Clumps
from labkit.errors import PhysicsError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.snapshot import Snapshot


def critical_time_step(state: State, snapshot: Snapshot | None = None) -> float:
    """Return the time step (s) below which the integration of a state is stable; inf without contacts.

    In the leapfrog scheme, with forces evaluated at the velocity of half a step earlier, a mode of x'' + C x' + K x = 0
    is stable as long as dt^2 K + 2 dt C < 4: a dashpot lowers the limit from 2/omega to
    2/omega (sqrt(1 + zeta^2) - zeta). K of every mode is at most twice the largest
    eigenvalue of M^-1 K_g of any grain, and likewise for C. K_g (6 x 6) is the stiffness of one grain while all
    others are fixed: the energy k (u_a - u_b)^2/2 of a contact is at most k (u_a^2 + u_b^2). K_g includes translation
    and rotation, tangential and rolling stiffness; C includes the dashpots of the contact law. Pass the Snapshot of the
    state if it is already computed.
    """
    snapshot = (snapshot or state.snapshot()).spheres
    contacts = snapshot.contacts
    if len(contacts) == 0:
        return np.inf
    scene = state.scene
    a, b = state.radius[contacts.grain[:, 0]], state.radius[contacts.grain[:, 1]]
    *stiffness, cn, ct = scene.contact_law.tangents(scene, a, b, contacts.overlap)
    K = 2.0 * largest_eigenvalues(snapshot, stiffness, state.bodies)
    C = np.zeros_like(K)
    if cn.any() or ct.any():
        C = 2.0 * largest_eigenvalues(snapshot, [cn, ct, np.zeros_like(cn), np.zeros_like(cn)], state.bodies)
    with np.errstate(divide="ignore"):  # grains without contacts have no limit: 4/0
        return float(np.min(4.0 / (C + np.sqrt(C**2 + 4.0 * K))))


CHUNK = 20_000  # contacts or grains at a time: matrices for all of them would need more memory than the simulation


def largest_eigenvalues(
    snapshot: Snapshot, coefficients: Sequence[np.ndarray], bodies: Clumps | None = None
) -> np.ndarray:
    """Return the largest eigenvalue of M^-1 K_g for every grain, (grain,), or for every body that the grains form.

    Args:
        snapshot: The snapshot of the grains.
        coefficients: Normal and tangential stiffness (N/m) and rolling and twisting stiffness (N m) of the contacts,
            (contact,) each; or the dashpot coefficients, N s/m and N m s.
        bodies: The bodies that the grains form; None for single grains.
    """
    scene, contacts = cast(Scene, snapshot.scene), snapshot.contacts
    radius, grains = snapshot.radius, snapshot.number_of_grains
    K = np.zeros((grains, 6, 6))
    for first in range(0, len(contacts), CHUNK):
        some = slice(first, first + CHUNK)
        _add_contacts(
            K, radius, contacts.grain[some], contacts.normal[some], [coefficient[some] for coefficient in coefficients]
        )
    if bodies is not None:
        return bodies.largest_eigenvalues(K, cast(np.ndarray, snapshot.position), scene.density)
    largest = np.empty(grains)
    for first in range(0, grains, CHUNK):
        some = slice(first, first + CHUNK)
        inertia = np.stack([scene.mass(radius[some])] * 3 + [scene.moment_of_inertia(radius[some])] * 3, axis=1)
        scaling = 1.0 / np.sqrt(inertia)
        largest[some] = np.linalg.eigvalsh(K[some] * scaling[:, :, None] * scaling[:, None, :])[:, -1]
    return largest


def _add_contacts(
    K: np.ndarray, radius: np.ndarray, grains: np.ndarray, n: np.ndarray, coefficients: Sequence[np.ndarray]
) -> None:
    """Add the stiffness of contacts between `grains` (n, 2) with normals n (n, 3) to K (grain, 6, 6) of both grains."""
    nn = n[:, :, None] * n[:, None, :]
    tangent = np.eye(3) - nn
    cross = np.zeros_like(nn)  # cross-product matrix of n
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -n[:, 2], n[:, 1], -n[:, 0]
    cross -= cross.transpose(0, 2, 1)
    normal, tangential, rolling, twisting = (values[:, None, None] for values in coefficients)
    twist = twisting * nn
    for side, sign in ((0, 1.0), (1, -1.0)):
        grain = grains[:, side]
        R = radius[grain][:, None, None]
        coupling = sign * tangential * R * cross
        np.add.at(K[:, :3, :3], grain, normal * nn + tangential * tangent)
        np.add.at(K[:, 3:, 3:], grain, (tangential * R**2 + rolling) * tangent + twist)
        np.add.at(K[:, 3:, :3], grain, coupling)
        np.add.at(K[:, :3, 3:], grain, coupling.transpose(0, 2, 1))


def require_stable(state: State, snapshot: Snapshot | None = None) -> None:
    """Raise PhysicsError if the time step exceeds the stability limit.

    Pass the Snapshot of the state if it is already computed.
    """
    limit = critical_time_step(state, snapshot)
    if state.time_step > limit:
        raise PhysicsError(
            f"the time step {state.time_step:.3g} s exceeds the stability limit {limit:.3g} s: "
            f"reduce time_step_factor from {state.scene.time_step_factor:g}"
        )
