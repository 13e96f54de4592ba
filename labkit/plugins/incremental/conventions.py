"""The driver's conventions and labkit's: axes, signs, units and the order of components.

In the driver, tension is positive, axis 1 is the axis of symmetry, the order of components is 11, 22, 33, 12, 13, 23,
and shear strains are engineering strains. In labkit, compression is positive and z is the axis of symmetry: the axes
1, 2, 3 are z, x, y. The driver has no units; the user chooses the unit of its stresses.
"""

from __future__ import annotations

import numpy as np

from labkit.paths.variables import VARIABLES, Variables

AXES = (2, 0, 1)  # labkit's axis (0, 1, 2 for x, y, z) for each of the driver's axes 1, 2, 3
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # pairs of the driver's axes, in the order of its components
NAMES = tuple("".join(sorted("xyz"[AXES[k]] for k in pair)) for pair in PAIRS)  # zz, xx, yy, xz, yz, xy
SYSTEMS = {  # keyword -> labkit's variables, and the sign of the driver's variables relative to labkit's
    "*cartesian": ("cartesian", (-1.0,) * 6),
    "*roscoe": ("roscoe", (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)),
    "*roscoeisomorph": ("roscoe_isomorph", (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)),
    "*rendulic": ("rendulic", (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)),
}
STRESS_UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}


def system(keyword: str) -> tuple[Variables, np.ndarray]:
    """Return labkit's Variables for a keyword of the driver, e.g. `*Roscoe`, and the signs (6,) of the driver's."""
    name, signs = SYSTEMS[keyword.lower()]
    return VARIABLES[name], np.array(signs)


def tensor(components: np.ndarray, shear: float = 1.0) -> np.ndarray:
    """Convert the driver's components (..., 6), tension positive, to labkit's tensor (..., 3, 3).

    `shear` multiplies the shear components; it is 0.5 for engineering shear strains.
    """
    components = np.asarray(components, dtype=float)
    result = np.empty((*components.shape[:-1], 3, 3))
    for k, (a, b) in enumerate(PAIRS):
        i, j = AXES[a], AXES[b]
        result[..., i, j] = result[..., j, i] = -components[..., k] * (1.0 if a == b else shear)
    return result


def components(tensors: np.ndarray, shear: float = 1.0) -> np.ndarray:
    """Convert labkit's tensors (..., 3, 3) to the driver's components (..., 6), tension positive (see `tensor`)."""
    columns = [-tensors[..., AXES[a], AXES[b]] / (1.0 if a == b else shear) for a, b in PAIRS]
    return np.stack(columns, axis=-1)


def rotate(matrix: np.ndarray) -> np.ndarray:
    """Rotate a matrix (3, 3) from the driver's axes to labkit's, without a change of sign."""
    result = np.empty((3, 3))
    result[np.ix_(AXES, AXES)] = matrix
    return result
