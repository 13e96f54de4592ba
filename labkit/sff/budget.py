"""The error of C0 taken apart: parts that add up to C0 - Love exactly.

Between C0 and Love lies a chain of stresses, each with one assumption less; a part is the difference of two
neighbours:

    C0 -> E_PDF to order 4 -> Lambda_n to order 4 -> tangential force to order 2 -> the contacts themselves (Eq. 20)
       -> with lambda' -> with the volume of whole grains -> each side with its own weight: Love (Eq. 4)

What is left between the fits and the contacts themselves is the scatter of a finite sample, and orders beyond the
fourth: `sampling`. It is the part that has a standard error of its own size (see `standard_errors`).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.micro.contacts import Contacts
from labkit.micro.directions import second_order
from labkit.micro.fabric import series_of
from labkit.micro.normalised import Vectors, vectors_of_contacts
from labkit.micro.stress import love_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.sff.family import bracket

PARTS = {
    "normals": "truncation of E_PDF",
    "normal_forces": "truncation of Lambda_n",
    "tangential_forces": "truncation of Lambda_t",
    "sampling": "sampling, higher orders",
    "overlap_correction": "lambda' left out",
    "grain_volume": "overlaps in V_g",
    "equal_stress": "equal stress of all sizes",
}
VOID_RATIOS = {"nominal": lambda radius, volume, contacts: void_ratio_nominal(radius, volume), "reported": void_ratio}


def error_budget(contacts, radius, volume, young_modulus, e="nominal", with_lambda=True):
    """The parts of C0 - Love, name -> (3, 3) Pa, in the order of PARTS; all zero without contacts or forces.

    C0 is taken as the paper derives it: `e = "nominal"` and lambda' in f~; both of these parts are zero then. With
    `e = "reported"` it has the void ratio of Fig. 1, overlaps taken out; `with_lambda=False` leaves lambda' out.
    """
    if len(contacts) == 0 or not contacts.normal_force.any():
        return {name: np.zeros((3, 3)) for name in PARTS}
    E, Z = young_modulus, 2 * len(contacts) / len(radius)
    own = E * Z / (1.0 + VOID_RATIOS[e](radius, volume, contacts))
    nominal = E * Z / (1.0 + void_ratio_nominal(radius, volume))
    exact = vectors_of_contacts(radius, contacts, E)
    used = exact if with_lambda else _without_lambda(contacts, radius, E)
    second, fourth = series_of(used, 2), series_of(used, 4)
    chain = {
        "C0": own * bracket(second, 0),
        "normals": own * bracket(dataclasses.replace(fourth, normal_force=second_order(fourth.normal_force)), 0),
        "normal_forces": own * bracket(fourth, 0),
        "tangential_forces": own * bracket(fourth, 2),
        "sampling": own * _mean_stress_of(used),
        "overlap_correction": own * _mean_stress_of(exact),
        "grain_volume": nominal * _mean_stress_of(exact),
        "equal_stress": love_stress(contacts, radius, volume),
    }
    names = list(chain)
    return {name: chain[before] - chain[name] for before, name in zip(names, names[1:])}


def standard_errors(contacts, radius, volume, young_modulus, samples=50, seed=1):
    """Standard errors of the parts from `samples` bootstraps of the contacts: name -> (3, 3) Pa."""
    rng = np.random.default_rng(seed)
    found = [
        error_budget(_chosen(contacts, rng.integers(0, len(contacts), len(contacts))), radius, volume, young_modulus)
        for _ in range(samples)
    ]
    return {name: np.std([budget[name] for budget in found], axis=0, ddof=1) for name in PARTS}


def _chosen(contacts, rows):
    return Contacts(*(getattr(contacts, name)[rows] for name in Contacts.__dataclass_fields__))


def _mean_stress_of(vectors):
    """<Lambda_n nn - n (x) Lambda_t> over the contacts themselves (Eq. 20), shape (3, 3)."""
    n = vectors.normal
    return ((n * vectors.normal_component[:, None]).T @ n - n.T @ vectors.tangential) / len(n)


def _without_lambda(contacts, radius, E):
    """Vectors with f~ = 3 f/(pi D^2)."""
    weight = (3.0 / (np.pi * (2.0 * radius[contacts.grain]) ** 2 * E)).mean(axis=1)
    return Vectors(contacts.normal, weight * contacts.normal_force, weight[:, None] * contacts.tangential_force)
