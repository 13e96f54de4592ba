"""The servo (Eqs. 5 and 6): strain rates that bring measured stresses to their targets.

Eq. 5 divides the stress error by a stiffness and by the time between two corrections. To be dimensionally consistent,
the strain rate must be (sigma^t - sigma)/(M T), with M the stiffness of the cell, Pa, and T the time to the next
correction. Eq. 6 uses the mean stiffness of one contact for M, which gives a loop gain of M L/K, between 1 and 10 and
increasing with the number of contacts. Here M is the stiffness of the cell when all grains follow the mean field: an
upper bound on the real stiffness, which is reduced by slip and rearrangement.

The gain. With e = sigma^t - sigma, r the strain rate and the low-pass filter of the paper,

    r_k = 0.75 r_(k-1) + 0.25 g e_k/(M T)      e_(k+1) = e_k - M' T r_k,      M' <= M the real stiffness,

the error obeys z^2 - (1.75 - 0.25 h) z + 0.75 = 0 with h = g M'/M. This is stable for 0 < h < 14. For any h from 0.07
to 13.9 the roots have the modulus sqrt(0.75), so that an error falls to a tenth within 16 corrections whatever the
stiffness. While the cell is sheared at the rate r*, the stress lags by r* M T/g. g = 2 leaves a margin of seven to the
stability limit, to allow for the grain dynamics neglected in this analysis, and gives a lag of 0.2 kPa at 10 1/s with T
of 5 steps. `labkit speed-error` measures other gains and intervals.
"""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np

from labkit.dem.loading import Path
from labkit.dem.scene import Scene
from labkit.errors import InputError
from labkit.micro.snapshot import Snapshot
from labkit.parameters import check_parameters, parameter

LOW_PASS = 0.25
RATE_LIMIT = 3.0  # of the rate of the path
FLOOR = 1e-3  # of E: keeps the stiffness of a cell without contacts above zero


@dataclasses.dataclass(frozen=True)
class Servo:
    """Gain and interval of the stress corrections. Raises InputError for values outside their ranges."""

    gain: float = parameter(2.0, above=0.0, high=1e3, help="gain of the servo")
    interval: int = parameter(5, low=1, high=10**6, help="steps between two corrections")

    def __post_init__(self) -> None:
        """Check every parameter."""
        check_parameters(self)


STANDARD = Servo()


def cell_stiffness(snapshot: Snapshot) -> np.ndarray:
    """Stiffness d(sigma_ii)/d(eps_jj) of a cell whose grains follow the mean field, shape (3, 3), Pa.

    (1/V) sum over contacts of b^2 [kn ni^2 nj^2 + kt (delta_ij ni^2 - ni^2 nj^2)], b the branch length.
    """
    scene, radius, contacts = cast(Scene, snapshot.scene), snapshot.radius, snapshot.contacts
    a, b = radius[contacts.grain[:, 0]], radius[contacts.grain[:, 1]]
    kn, kt = scene.normal_stiffness(a, b), scene.tangential_stiffness(a, b)
    squared = contacts.normal**2
    length2 = contacts.branch_length(radius) ** 2
    normal = (squared * ((kn - kt) * length2)[:, None]).T @ squared
    tangential = np.diag((kt * length2) @ squared)
    return (normal + tangential) / snapshot.volume + FLOOR * snapshot.young_modulus * np.eye(3)


def velocity_gradient(
    path: Path,
    sign: float,
    time_step: float,
    stress: np.ndarray | None = None,
    stiffness: np.ndarray | None = None,
    before: np.ndarray | None = None,
    servo: Servo = STANDARD,
) -> np.ndarray:
    """The velocity gradient L (3, 3), 1/s, of a path until the next correction of the `servo`.

    Prescribed rates give 1 + L dt = exp(-rate dt) in every step: the cell follows the logarithmic strains exactly, and
    an isochoric rate preserves the volume. `sign` = -1 reverses the path. A path with a Control needs the current
    `stress` (3, 3) Pa, the `stiffness` of the cell (3, 3) Pa, and `before`, the gradient (3, 3) 1/s up to now. Raises
    InputError if the path has no rate or one of these is missing.
    """
    given = sign * path.axial_rate * np.array(path.direction)
    L = np.expm1(-given * time_step) / time_step
    control = path.control()
    if control is not None:
        if stress is None or stiffness is None or before is None:
            raise InputError(f"path {path.name} controls a stress: give `stress`, `stiffness` and `before`")
        missing = control.target - control.measure @ np.diag(stress)
        response = control.measure @ stiffness @ control.free
        rates = control.free @ (servo.gain / (servo.interval * time_step) * np.linalg.solve(response, missing))
        limit = RATE_LIMIT * path.axial_rate
        wanted = -np.clip(rates, -limit, limit)
        held = control.free.any(axis=1)
        L[held] = LOW_PASS * wanted[held] + (1.0 - LOW_PASS) * np.diag(before)[held]
    return np.diag(L)
