"""Error budget of C0: contributions whose sum is exactly C0 - Love.

A chain of stresses leads from C0 to Love's stress. Each stress makes one assumption fewer than its predecessor, and a
contribution is the difference between two successive stresses:

    C0 -> E_PDF to order 4 -> Lambda_n to order 4 -> tangential force to order 2 -> the contacts themselves (Eq. 20)
       -> including lambda' -> with the full volume of each grain
       -> with a separate weight for each contact side, which is Love's stress (Eq. 4)

The contribution `sampling`, between the fits and the contacts themselves, contains the scatter of a finite sample and
all orders above the fourth. Its standard error is comparable to its magnitude (see `standard_errors`).
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from labkit.micro.contact_sides import Vectors, vectors_of_contacts
from labkit.micro.fabric import second_order, series_of
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.sff.family import sphere_integral

PARTS = {
    "normals": "truncation of E_PDF",
    "normal_forces": "truncation of Lambda_n",
    "tangential_forces": "truncation of Lambda_t",
    "sampling": "sampling, higher orders",
    "overlap_correction": "lambda' neglected",
    "grain_volume": "overlaps in V_g",
    "equal_stress": "equal stress of all sizes",
}
VOID_RATIOS = {"nominal": void_ratio_nominal, "reported": void_ratio}


def error_budget(snapshot: Snapshot, e: str = "nominal", with_lambda: bool = True) -> dict[str, np.ndarray]:
    """Return the contributions to C0 - Love, name -> (3, 3) Pa, in the order of PARTS; zero without contacts or forces.

    By default C0 is evaluated as derived in the paper, with the nominal void ratio and with lambda' in f~, so
    `grain_volume` and `overlap_correction` are zero. `e="reported"` uses the void ratio of Fig. 1, which is corrected
    for overlaps; `with_lambda=False` neglects lambda'.
    """
    if len(snapshot.contacts) == 0 or not snapshot.contacts.normal_force.any():
        return {name: np.zeros((3, 3)) for name in PARTS}
    EZ = snapshot.young_modulus * 2 * len(snapshot.contacts) / snapshot.number_of_grains
    factor = EZ / (1.0 + VOID_RATIOS[e](snapshot))
    nominal = EZ / (1.0 + void_ratio_nominal(snapshot))
    exact = vectors_of_contacts(snapshot)
    used = exact if with_lambda else _without_lambda(snapshot)
    second, fourth = series_of(used, 2), series_of(used, 4)
    normals = dataclasses.replace(fourth, normal_force=second_order(fourth.normal_force))
    chain = {
        "C0": factor * sphere_integral(second, 0),
        "normals": factor * sphere_integral(normals, 0),
        "normal_forces": factor * sphere_integral(fourth, 0),
        "tangential_forces": factor * sphere_integral(fourth, 2),
        "sampling": factor * _mean_stress_of(used),
        "overlap_correction": factor * _mean_stress_of(exact),
        "grain_volume": nominal * _mean_stress_of(exact),
        "equal_stress": love_stress(snapshot),
    }
    names = list(chain)
    return {name: chain[before] - chain[name] for before, name in itertools.pairwise(names)}


def standard_errors(snapshot: Snapshot, samples: int = 50) -> dict[str, np.ndarray]:
    """Return standard errors of the contributions, name -> (3, 3) Pa, from bootstrap samples of the contacts."""
    rng = np.random.default_rng(1)
    contacts = len(snapshot.contacts)
    budgets = [error_budget(_with_contacts(snapshot, rng.integers(0, contacts, contacts))) for _ in range(samples)]
    return {name: np.std([budget[name] for budget in budgets], axis=0, ddof=1) for name in PARTS}


def _with_contacts(snapshot, rows):
    """Return the snapshot with a selection of its contacts; a row may occur several times."""
    return dataclasses.replace(snapshot, contacts=snapshot.contacts.take(rows))


def _mean_stress_of(vectors):
    """Return the mean of Lambda_n nn - n (x) Lambda_t over the contacts, without a fit (Eq. 20), shape (3, 3).

    For grains that are not spheres the mean includes the terms due to eccentric contacts.
    """
    n = vectors.normal
    mean = ((n * vectors.normal_component[:, None]).T @ n - n.T @ vectors.tangential) / len(n)
    if vectors.eccentric is None:
        return mean
    of_normal, of_tangential = vectors.eccentric.mean(axis=1)
    return mean + of_normal - of_tangential


def _without_lambda(snapshot):
    """Return the Vectors of the contacts with f~ = 3 f/(pi D^2), neglecting lambda'."""
    contacts = snapshot.contacts
    diameter = 2.0 * snapshot.radius[contacts.grain]
    weight = (3.0 / (np.pi * diameter**2 * snapshot.young_modulus)).mean(axis=1)
    force, eccentric = contacts.normal_force, vectors_of_contacts(snapshot).eccentric
    return Vectors(contacts.normal, weight * force, weight[:, None] * contacts.tangential_force, eccentric)
