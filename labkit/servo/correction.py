"""The servo (Eqs. 5 and 6): adjusts strain rates so that measured stresses reach their targets.

Eq. 5 divides the stress error by a stiffness and by the time between two corrections. To be dimensionally consistent,
the strain rate must be (sigma^t - sigma)/(M T), with M the stiffness (Pa) of the cell and T the time to the next
correction. Eq. 6 uses the mean stiffness of one contact for M, which leads to a loop gain of M L/K between 1 and
10 that increases with the number of contacts. Here M is the stiffness of the cell when all grains follow the mean
field: an upper bound on the real stiffness, which is reduced by slip and rearrangement.

The gain is chosen as follows. With the stress error e = sigma^t - sigma, the strain rate r and the low-pass filter of
the paper,

    r_k = 0.75 r_(k-1) + 0.25 g e_k/(M T)      e_(k+1) = e_k - M' T r_k,      M' <= M (the real stiffness),

the error obeys z^2 - (1.75 - 0.25 h) z + 0.75 = 0 with h = g M'/M. This is stable for 0 < h < 14. For any h from 0.07
to 13.9 the roots have the modulus sqrt(0.75), so an error falls to a tenth within 16 corrections for any stiffness
in this range. While the cell is sheared at the rate r*, the stress lags by r* M T/g. g = 2 is a factor of seven below
the stability limit, which allows for the grain dynamics that this analysis neglects, and leads to a lag of 0.2 kPa at a
rate of 10 1/s and T = 5 time steps. `./lab speed-error` measures other gains and intervals.
"""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np

from labkit.grains.scene import Scene
from labkit.micro.snapshot import Snapshot
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.parameters import Number, check_parameters, parameter

FLOOR = 1e-3  # fraction of E; keeps the stiffness above zero in a cell without contacts


@dataclasses.dataclass(frozen=True)
class Servo:
    """Gain and interval of the stress corrections. Raises InputError for values outside their ranges."""

    gain: Number[float] = parameter(2.0, above=0.0, high=1e3, help="gain of the servo")
    interval: Number[int] = parameter(5, low=1, high=10**6, help="steps between two corrections")

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)


STANDARD = Servo()


def cell_stiffness(snapshot: Snapshot, components: int = 3) -> np.ndarray:
    """Return the stiffness (Pa) of the cell if all grains moved with the mean field, an upper bound on the real one.

        C = (1/V) sum over contacts of b^2 [kn nnnn + kt (sym(delta nn) - nnnn)]

    with the branch length b and sym(delta nn)_ijkl = (delta_ik nj nl + delta_il nj nk + delta_jk ni nl + delta_jl ni
    nk)/4. Its shape is (6, 6) in Mandel notation (labkit.micro.tensors); with `components` = 3 only the block of normal
    components is returned.
    """
    scene, spheres = cast(Scene, snapshot.scene), snapshot.spheres
    (a, b), contacts = spheres.radii, spheres.contacts
    kn, kt, *_ = scene.contact_law.tangents(scene, a, b, contacts.overlap)
    if snapshot.contacts.vectors is not None:
        return _stiffness_off_normals(snapshot, kn, kt)[:components, :components]
    n, length2 = contacts.normal, contacts.branch_length(spheres.radius) ** 2
    squared = n**2
    normal = (squared * ((kn - kt) * length2)[:, None]).T @ squared
    tangential = np.diag((kt * length2) @ squared)
    block = (normal + tangential) / snapshot.volume + FLOOR * snapshot.young_modulus * np.eye(3)
    if components == 3:
        return block
    six = to_six(n[:, :, None] * n[:, None, :])
    fabric = to_tensor((kt * length2) @ six)
    basis = to_tensor(np.eye(6))
    sheared = np.einsum("aij,jk,bik->ab", basis, fabric, basis)
    whole = ((six * ((kn - kt) * length2)[:, None]).T @ six + 0.5 * (sheared + sheared.T)) / snapshot.volume
    whole += FLOOR * snapshot.young_modulus * np.eye(6)
    whole[:3, :3] = block
    return whole


def _stiffness_off_normals(snapshot: Snapshot, kn: np.ndarray, kt: np.ndarray) -> np.ndarray:
    """Return the stiffness (6, 6), in Pa, if branches b are not parallel to n: nbnb for b^2 nnnn, bb for b^2 nn."""
    branch, n = snapshot.contacts.branch(snapshot.radius), snapshot.contacts.normal
    six, basis = to_six(symmetric(n[:, :, None] * branch[:, None, :])), to_tensor(np.eye(6))
    fabric = (branch * kt[:, None]).T @ branch
    sheared = np.einsum("aij,jk,bik->ab", basis, fabric, basis)
    whole = ((six * (kn - kt)[:, None]).T @ six + 0.5 * (sheared + sheared.T)) / snapshot.volume
    return whole + FLOOR * snapshot.young_modulus * np.eye(6)


def exact_gradient(rate: np.ndarray, time_step: float) -> np.ndarray:
    """Return L (3, 3), in 1/s, such that 1 + L dt = exp(-rate dt), for prescribed rates (3, 3), in 1/s."""
    diagonal = rate.diagonal()
    if np.count_nonzero(rate) == np.count_nonzero(diagonal):
        return np.diag(np.expm1(-diagonal * time_step) / time_step)
    power = term = -rate
    for k in range(2, 9):  # |rate dt| is far below 1
        term = term @ (-rate * time_step) / k
        power = power + term
    return power
