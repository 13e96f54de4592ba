"""The spring-dashpot law as coefficients of LAMMPS's pair style granular, one set for each pair of size classes.

LAMMPS has one set of coefficients per pair of atom types, whereas labkit has one set per pair of grains. All grains of
a type therefore have the same radius, which makes the coefficients exact. In the notation of LAMMPS, with r* = Ra
Rb/(Ra + Rb):

    hooke kn eta, damping velocity      fn = kn delta + eta ddelta/dt               eta = 2 beta_n sqrt(m* kn)
    linear_history kt xgammat mu        |kt xi + xgammat eta dxi/dt| <= mu |fn|     xgammat = ct/cn
    rolling sds k gamma mu              M = k r*^2 theta, |M| <= mu r* |fn|         k = kr/r*^2, gamma = 0, mu = mu_r
"""

from __future__ import annotations

import numpy as np

from labkit.errors import InputError
from labkit.grains.laws.named import SpringDashpot
from labkit.grains.scene import Scene

MOST_CLASSES = 64  # largest number of size classes, which need 2080 sets of coefficients


def classes_of(radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the class index of each grain (grain,), and the radius of each class (class,), in m.

    Raises InputError if the grains have too many different radii.
    """
    sizes, kind = np.unique(radius, return_inverse=True)
    if len(sizes) > MOST_CLASSES:
        raise InputError(
            f"the grains have {len(sizes)} different radii and LAMMPS needs one set of coefficients for each pair of "
            f"radii: make the specimen with --size-classes 16 (at most {MOST_CLASSES})"
        )
    return kind.reshape(-1), sizes


def pair_coefficients(scene: Scene, radius: np.ndarray) -> list[str]:
    """Return the pair_coeff command of each pair of classes.

    The contact law is the spring-dashpot law.
    Raises InputError for beta_t without beta_n.

    Args:
        scene: Scene of the grains.
        radius: Radius of each class, (class,), in m.
    """
    lines = []
    for first, a in enumerate(radius):
        for second, b in enumerate(radius[first:], first):
            kn, kt, kr = (
                stiffness(a, b)
                for stiffness in (scene.normal_stiffness, scene.tangential_stiffness, scene.rolling_stiffness)
            )
            *_, cn, ct = SpringDashpot().tangents(scene, a, b, np.zeros(()))
            if cn == 0.0 < ct:
                raise InputError("LAMMPS does not support beta_t without beta_n: set beta_n above 0, or beta_t = 0")
            share = ct / cn if cn > 0.0 else 0.0
            rolling = kr / (a * b / (a + b)) ** 2
            lines.append(
                f"pair_coeff {first + 1} {second + 1} hooke {kn:.17g} {cn:.17g} "
                f"tangential linear_history {kt:.17g} {share:.17g} {scene.friction:.17g} "
                f"rolling sds {rolling:.17g} 0.0 {scene.rolling_friction:.17g} damping velocity"
            )
    return lines
