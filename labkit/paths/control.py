"""Mixed control: prescribed strain rates, held stresses, and the free strain rates by which they are held.

    D = D0 + sum_j x_j P_j        M_i : sigma = s_i(t)        i, j = 1 ... k, k <= 6

A path prescribes the strain rate D0. The servo (labkit.servo.correction) sets the k numbers x_j so that the k stresses
M_i : sigma follow the targets s_i, which are constant or functions of the accumulated strain t.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import COMPONENTS, ROOT2, to_six
from labkit.parameters import Parameter

Target = Callable[[float], Sequence[float]]

# A control is possible if it works for an isotropic elastic body with K = G.
_ISOTROPIC = 2.0 * np.eye(6) + (1.0 - 2.0 / 3.0) * np.outer(*[np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])] * 2)
SINGULAR = 1e-9
_X_FOR_Y = [1, 0, 2, 4, 3, 5]  # order of the six components if x and y are exchanged
_MEAN = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3.0


def _in_pascals(stresses: object) -> object:
    """Convert stresses to Pa; the stresses in a list may be text with a unit."""
    if not isinstance(stresses, list | tuple):
        return stresses
    return [Parameter("target", unit="Pa").read(stress) if isinstance(stress, str) else stress for stress in stresses]


def six_columns(tensors: object) -> np.ndarray:
    """Convert k tensors (k, 3, 3), or only their normal components (k, 3), to Mandel notation, shape (k, 6).

    An array that already has six columns is returned unchanged.
    """
    tensors = np.asarray(tensors, dtype=float)
    return to_six(tensors) if tensors.ndim == 3 else np.pad(tensors, ((0, 0), (0, 6 - tensors.shape[-1])))


@dataclasses.dataclass(frozen=True)
class Water:
    """Pore water that cannot drain: its excess pressure is u = K_w/n ln(V_0/V), while the grains do not compress.

    Args:
        stiffness: K_w/n, bulk modulus of the water over the porosity of the specimen, Pa.
        volume: V_0, volume of the cell (m3) at which u is 0.
    """

    stiffness: float
    volume: float

    def pressure(self, volume: float) -> float:
        """Return the excess pore pressure, Pa, at a volume of the cell, m3."""
        return self.stiffness * math.log(self.volume / volume)


@dataclasses.dataclass(frozen=True)
class Control:
    """Stresses that the servo holds, and the strain rates that it adjusts to hold them.

    The tensors are stored in Mandel notation (labkit.micro.tensors): measure (k, 6), free (6, k). Raises InputError for
    shapes that do not match, tensors that are not symmetric, and a control that no material can follow.

    Args:
        measure: The k tensors M_i, shape (k, 3, 3), or (k, 3) if only normal stresses are measured.
        free: The k tensors P_j, shape (k, 3, 3), or (3, k) if only normal strain rates are adjusted.
        target: The k stresses, Pa, shape (k,), or a function of the accumulated strain that returns them.
        triangular: True to add the spin that keeps the cell upper triangular: its first vector stays along x, the
            second in the plane xy. An isotropic stress does not depend on the spin.
        water: Water in the pores, with which the held stresses are total stresses; None to hold effective stresses.
    """

    measure: Any
    free: Any
    target: Any
    triangular: bool = False
    water: Water | None = None

    def __post_init__(self) -> None:
        """Convert the tensors to Mandel notation. Raises InputError."""
        measure, free = (np.asarray(value, dtype=float) for value in (self.measure, self.free))
        target = self.target if callable(self.target) else np.asarray(_in_pascals(self.target), dtype=float)
        k = len(np.atleast_1d(target(0.0))) if callable(target) else target.size
        if measure.shape not in ((k, 3), (k, 3, 3)) or free.shape not in ((3, k), (k, 3, 3)) or not 1 <= k <= 6:
            raise InputError(
                f"a Control has arrays of inconsistent shape: measure {measure.shape}, free {free.shape}, target "
                f"({k},); with k held stresses, measure must be (k, 3) or (k, 3, 3), free (3, k) or (k, 3, 3), "
                "and target (k,)"
            )
        for name, value in (("measure", measure), ("free", free)):
            if value.ndim == 3 and not np.array_equal(value, value.transpose(0, 2, 1)):
                raise InputError(f"a Control has a {name} that is not symmetric: give (T + T^T)/2")
        object.__setattr__(self, "measure", six_columns(measure))
        object.__setattr__(self, "free", six_columns(free if free.ndim == 3 else free.T).T)
        object.__setattr__(self, "target", target)

    def require_possible(self) -> None:
        """Raise InputError if a held stress does not respond to the free strain rates."""
        response = self.measure @ _ISOTROPIC @ self.free
        for name, row in zip(self.names, response, strict=True):
            if np.abs(row).max() < SINGULAR:
                raise InputError(
                    f"the stress {name} is held, but the strain rates that would change it are prescribed: free one "
                    "of them or do not hold this stress"
                )
        if np.linalg.cond(response) > 1.0 / SINGULAR:
            raise InputError(
                f"the held stresses {', '.join(self.names)} cannot be set independently by the free strain rates: "
                "give as many independent strain rates as stresses"
            )

    @functools.cached_property
    def coaxial(self) -> bool:
        """True if only normal stresses and normal strain rates are involved."""
        return not (self.measure[:, 3:].any() or self.free[3:].any())

    @property
    def axisymmetric(self) -> bool:
        """True if exchanging x and y does not change the control."""
        rows = np.column_stack([self.measure, self.at(0.0) / max(np.abs(self.at(0.0)).max(), 1.0)])
        exchanged = np.column_stack([self.measure[:, _X_FOR_Y], rows[:, -1]])
        pairs = (rows, exchanged), (self.free.T, self.free[_X_FOR_Y].T)
        return all(np.linalg.matrix_rank(np.vstack(pair)) == np.linalg.matrix_rank(pair[0]) for pair in pairs)

    @property
    def components(self) -> int:
        """Number of components that the servo must follow: 3, or 6 with shear."""
        return 3 if self.coaxial else 6

    @functools.cached_property
    def project(self) -> np.ndarray:
        """Matrix (6, 6) that projects a strain rate onto the free strain rates."""
        return self.free @ np.linalg.pinv(self.free)

    @functools.cached_property
    def isochoric(self) -> bool:
        """True if none of the free strain rates changes the volume."""
        return bool(np.abs(self.free[:3].sum(axis=0)).max() < 1e-12)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the held stresses, e.g. ('sigma_xz', 'the mean stress', 'sigma_xx - 1 sigma_yy')."""
        return tuple(_combination(row) for row in self.measure)

    @property
    def share(self) -> np.ndarray:
        """Share of the pore pressure in each of the held stresses, M_i : I, (k,)."""
        return self.measure[:, :3].sum(axis=1)

    def at(self, accumulated: float, volume: float | None = None) -> np.ndarray:
        """Return the targets (k,), Pa, at the accumulated strain `accumulated`.

        With water, those of the effective stresses if the `volume` of the cell, m3, is given, else of the total ones.
        """
        target = np.asarray(self.target(accumulated) if callable(self.target) else self.target, dtype=float)
        return target if self.water is None or volume is None else target - self.water.pressure(volume) * self.share


def _combination(row: np.ndarray) -> str:
    """Write a linear combination of stresses as text."""
    if np.allclose(row, _MEAN, atol=1e-12):
        return "the mean stress"
    weights = row * np.array([1.0, 1.0, 1.0, ROOT2, ROOT2, ROOT2])  # M : sigma contains each shear stress twice
    terms = [(w, c) for w, c in zip(weights, COMPONENTS, strict=True) if abs(w) > 1e-12]
    if len(terms) == 1 and abs(terms[0][0] - 1.0) < 1e-12:
        return f"sigma_{terms[0][1]}"
    return " + ".join(f"{w:.3g} sigma_{c}" for w, c in terms).replace("+ -", "- ")
