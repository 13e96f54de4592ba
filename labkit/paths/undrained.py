"""Undrained triaxial tests: at constant volume or, with compressible pore water, at a constant total stress."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from labkit.parameters import Number, parameter
from labkit.paths.control import Control, Water
from labkit.paths.path import Held, Path
from labkit.paths.step import Here, Step
from labkit.quantities.scalars import TOTAL

_NORMAL = np.eye(3)[:, :, None] * np.eye(3)[:, None]  # unit stresses xx, yy, zz
_FREE = [[1.0], [1.0], [0.0]]  # equal strain rates in x and y


@dataclasses.dataclass(frozen=True)
class Undrained(Path):
    """An undrained triaxial test: the axial strain rate is prescribed, and no water leaves the pores.

    By default the water does not compress: the volume is constant, whatever the total stresses. With a bulk modulus K_w
    the excess pore pressure is u = K_w/n ln(V_0/V), with the volume V_0 and the porosity n at the start, and the servo
    adjusts the radial strain rate so that sigma' + u of the component `total` stays as it was at the start.
    """

    water: Number[float | None] = parameter(
        None, unit="Pa", low=0.0, high=1e15, help="bulk modulus of the pore water (default: infinite, constant volume)"
    )
    total: str | None = parameter(
        None, kind=str, choices=tuple(TOTAL), help="component of the total stress that is constant; r_u refers to it"
    )

    @property
    def _measure(self) -> np.ndarray:
        """The component `total` of a stress as coefficients of xx, yy, zz, (1, 3)."""
        return TOTAL[self.total or "mean"](_NORMAL)[None]

    def control(self) -> Control | None:
        return self._control(Here())

    def _control(self, start: Here) -> Control | None:
        if self.water is None:
            return None
        stress, (volume, e) = start.stress if start.first is None else start.first, start.pores
        pores = Water(self.water * (1.0 + e) / e, volume)
        return Control(self._measure, _FREE, self._measure @ stress.diagonal(), water=pores)

    def steps_from(self, start: Here) -> Iterable[Step]:
        held = self._control(start)
        for step in super().steps_from(start):
            yield dataclasses.replace(step, held=held)

    def held(self) -> tuple[Held, ...]:
        if self.water is None:
            return (Held("volume", "volume"),)
        return (Held(f"total {self.total or 'mean'} stress", "total", self._measure, np.array([self.water])),)
