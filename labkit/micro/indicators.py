"""Indicators of whether a test is quasi-static, overlaps are small and the specimen is at rest (section 2)."""

from __future__ import annotations

import numpy as np

from labkit.micro.snapshot import Snapshot, contacts_per_grain


def inertial_number(strain_rate: np.ndarray, pressure: float, diameter: float, density: float) -> float:
    """Return the inertial number I = |rate| D sqrt(rho/p) with the Euclidean norm (section 2).

    It is 0 at rest, and inf if a deforming specimen has no mean stress.

    Args:
        strain_rate: (3, 3), in 1/s.
        pressure: Mean stress (Pa).
        diameter: Mean diameter (m).
        density: Density of the grains (kg/m3).
    """
    norm = float(np.linalg.norm(strain_rate))
    if norm == 0.0:
        return 0.0
    return norm * diameter * np.sqrt(density / pressure) if pressure > 0.0 else np.inf


def overlap_ratio(snapshot: Snapshot) -> float:
    """Return the mean of delta/D, overlap over grain diameter, over all sides of touching contacts; 0 without any.

    For clumps, D is the diameter of the sphere that touches, because the spheres overlap.
    """
    contacts, radius = snapshot.spheres.contacts, snapshot.spheres.radius
    touching = contacts.overlap >= 0.0
    if not touching.any():
        return 0.0
    overlap, grain = contacts.overlap[touching], contacts.grain.compress(touching, 0)
    return float(np.mean(overlap.repeat(2) / (2.0 * radius.take(grain.ravel()))))


def rattler_fraction(snapshot: Snapshot) -> float:
    """Return the fraction of rattlers: grains with at most one contact, which carry no load."""
    return float(np.mean(contacts_per_grain(snapshot) < 2))


def redundancy_index(snapshot: Snapshot) -> float:
    """Return the constraints of the contacts over the degrees of freedom of the grains; NaN if no grain carries load.

    A contact resists 1 relative motion by its normal force, 2 by its tangential force unless it slides, 2 by rolling
    and 1 by twisting resistance below their limits. A grain has 6 degrees of freedom, or 3 if it is a sphere whose
    rotation nothing resists. Rattlers and their contacts are left out. Above 1 the packing has more contact forces than
    equilibrium needs; at 1 it is isostatic, and a specimen that liquefies falls below. Raises InputError for contacts
    with cohesion or bonds.
    """
    carries = contacts_per_grain(snapshot) >= 2
    between = carries[snapshot.contacts.grain].all(axis=1)
    constraints = snapshot.scene.contact_law.constraints(snapshot)[between]
    turns = snapshot.members is not None or bool((constraints > 1.0).any())
    freedom = (6.0 if turns else 3.0) * np.count_nonzero(carries)
    return float(constraints.sum() / freedom) if freedom else float("nan")


def resultant_forces(snapshot: Snapshot) -> np.ndarray:
    """Return the sum of the contact forces on each grain, shape (grain, 3), in N."""
    force, grains = snapshot.force_on_first, snapshot.number_of_grains
    first, second = snapshot.contacts.grain.T.astype(np.intp, order="C")
    total = [np.bincount(first, force[:, i], grains) - np.bincount(second, force[:, i], grains) for i in range(3)]
    return np.stack(total, axis=1)


def unbalanced_force(snapshot: Snapshot) -> float:
    """Return the mean resultant force on a grain divided by the mean contact force; 0 without contacts."""
    if len(snapshot.contacts) == 0:
        return 0.0
    resultant, mean_force = (
        np.sqrt(x * x + y * y + z * z).mean() for x, y, z in (resultant_forces(snapshot).T, snapshot.force_on_first.T)
    )
    return float(resultant / mean_force) if mean_force > 0.0 else 0.0


def elastic_energy(snapshot: Snapshot) -> float:
    """Return the elastic energy (J) of the contact springs according to the scene's contact law."""
    return snapshot.scene.contact_law.elastic_energy(snapshot)
