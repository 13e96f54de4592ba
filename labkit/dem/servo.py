"""The servo (Eqs. 5 and 6): strain rates that bring measured stresses to their targets.

Eq. 5 divides the missing stress by a stiffness and by the time between two corrections. Read as it must be, a
strain rate is (sigma^t - sigma)/(M T) with M the stiffness of the cell, Pa, and T the time to the next
correction. Eq. 6 gives for M the mean stiffness of one contact, which makes the loop gain M L/K, 1 to 10 and
growing with the number of contacts. Here M is the stiffness of the cell when all grains move with the mean
field: it is an upper bound of the real one, which grains that slip and rearrange make softer.

The gain. With e = sigma^t - sigma, r the rate and the low-pass of the paper,

    r_k = 0.75 r_(k-1) + 0.25 g e_k/(M T)      e_(k+1) = e_k - M' T r_k,      M' <= M the real stiffness,

the error obeys z^2 - (1.75 - 0.25 h) z + 0.75 = 0 with h = g M'/M: stable for 0 < h < 14, and for any h from
0.07 to 13.9 the roots have the modulus sqrt(0.75), so that an error falls to a tenth within 16 corrections
whatever the stiffness is. While the cell is sheared at the rate r*, the stress lags by r* M T/g. g = 2 leaves a
factor of seven to the limit of stability, for the dynamics of the grains that this sketch leaves out, and a lag
of 0.2 kPa for 10 1/s and T of 5 steps. `labkit speed-error` measures other gains and intervals.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from labkit.dem.paths import Path
from labkit.micro.snapshot import Snapshot
from labkit.parameters import check_parameters, parameter

LOW_PASS = 0.25
RATE_LIMIT = 3.0  # of the rate of the path
FLOOR = 1e-3  # of E: keeps the stiffness of a cell without contacts from being zero


@dataclasses.dataclass(frozen=True)
class Servo:
    """How strongly and how often stresses are corrected. Raises InputError for values that are not possible."""

    gain: float = parameter(2.0, above=0.0, high=1e3, help="gain of the servo")
    interval: int = parameter(5, low=1, high=10**6, help="steps between two corrections")

    def __post_init__(self) -> None:
        """Checks every parameter. Raises InputError."""
        check_parameters(self)


STANDARD = Servo()


def cell_stiffness(snapshot: Snapshot) -> np.ndarray:
    """d(sigma_ii)/d(eps_jj) if all grains moved with the mean field, shape (3, 3), Pa.

    (1/V) sum over contacts of b^2 [kn ni^2 nj^2 + kt (delta_ij ni^2 - ni^2 nj^2)], b the branch length.
    """
    scene, radius, contacts = snapshot.scene, snapshot.radius, snapshot.contacts
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
    """The velocity gradient L (3, 3), 1/s, of a path until the `servo` corrects again.

    Given rates make 1 + L dt = exp(-rate dt) in every step: the cell follows the logarithmic strains exactly,
    and a rate without volume keeps the volume. `sign` turns the path round. A path with a Control needs the
    `stress` (3, 3) Pa now, the cell's `stiffness` (3, 3) Pa, and `before`, the gradient (3, 3) 1/s until now.
    """
    given = sign * path.rate * np.array(path.direction)
    L = np.expm1(-given * time_step) / time_step
    control = path.control()
    if control is not None:
        missing = control.target - control.measure @ np.diag(stress)
        response = control.measure @ stiffness @ control.free
        rates = control.free @ (servo.gain / (servo.interval * time_step) * np.linalg.solve(response, missing))
        limit = RATE_LIMIT * path.rate
        wanted = -np.clip(rates, -limit, limit)
        held = control.free.any(axis=1)
        L[held] = LOW_PASS * wanted[held] + (1.0 - LOW_PASS) * np.diag(before)[held]
    return np.diag(L)
