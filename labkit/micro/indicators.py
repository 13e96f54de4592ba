"""Is the test quasi-static, the overlap small, the specimen at rest? (section 2)"""

from __future__ import annotations

import numpy as np

from labkit.micro.contacts import contacts_per_grain, grain_diameters


def inertial_number(strain_rate, pressure, diameter, density):
    """I = |rate| D sqrt(rho/p) with the Euclidean norm (section 2).

    `strain_rate` (3, 3) 1/s; inf where a deforming specimen carries no pressure, 0 at rest.
    """
    norm = float(np.linalg.norm(strain_rate))
    if norm == 0.0:
        return 0.0
    return norm * diameter * np.sqrt(density / pressure) if pressure > 0.0 else np.inf


def overlap_ratio(radius, contacts):
    """Mean of delta/D over the contact sides; 0 without contacts."""
    if len(contacts) == 0:
        return 0.0
    return float(np.mean(contacts.overlap[:, None] / grain_diameters(radius, contacts)))


def rattler_fraction(number_of_grains, contacts):
    """Share of the grains with no or one contact: they carry no load."""
    return float(np.mean(contacts_per_grain(number_of_grains, contacts) < 2))


def resultant_forces(number_of_grains, contacts):
    """Sum of the contact forces on each grain, shape (grain, 3), N."""
    force = contacts.force_on_first()
    first, second = contacts.grain[:, 0], contacts.grain[:, 1]
    total = [
        np.bincount(first, force[:, i], number_of_grains) - np.bincount(second, force[:, i], number_of_grains)
        for i in range(3)
    ]
    return np.stack(total, axis=1)


def unbalanced_force(number_of_grains, contacts):
    """Mean resultant force on a grain over the mean contact force; 0 without contacts."""
    if len(contacts) == 0:
        return 0.0
    resultant = np.linalg.norm(resultant_forces(number_of_grains, contacts), axis=1).mean()
    mean_force = np.linalg.norm(contacts.force_on_first(), axis=1).mean()
    return float(resultant / mean_force) if mean_force > 0.0 else 0.0


def fluctuation_velocity(state):
    """Velocity without the mean field, v - L x, shape (grain, 3), m/s."""
    return state.velocity - state.position @ state.velocity_gradient.T


def kinetic_energy(state):
    """Translational (mean field taken away) and rotational energy of all grains, J."""
    velocity = fluctuation_velocity(state)
    translation = state.scene.mass(state.radius) @ np.einsum("gi,gi->g", velocity, velocity)
    spin = np.einsum("gi,gi->g", state.angular_velocity, state.angular_velocity)
    return 0.5 * float(translation + state.scene.moment_of_inertia(state.radius) @ spin)


def elastic_energy(scene, radius, contacts):
    """Normal, tangential and rolling energy of the contact springs, J."""
    a, b = radius[contacts.grain[:, 0]], radius[contacts.grain[:, 1]]
    tangential = np.einsum("ci,ci->c", contacts.tangential_force, contacts.tangential_force)
    rolling = np.einsum("ci,ci->c", contacts.rolling_moment, contacts.rolling_moment)
    kn = scene.normal_stiffness(a, b)
    stored = (contacts.normal_force**2 + scene.stiffness_ratio * tangential) / kn
    return 0.5 * float(np.sum(stored + rolling / scene.rolling_stiffness(a, b)))


def drift_velocity(state):
    """Velocity of the centre of mass without the mean field, shape (3,), m/s: total momentum over mass."""
    mass = state.scene.mass(state.radius)
    return mass @ fluctuation_velocity(state) / mass.sum()
