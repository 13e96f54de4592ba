"""Rotation of the principal stresses at constant p, with the strength of the grains as q.

At the critical state q cannot be prescribed, because it is the strength of the grains. The path prescribes the strain
rate along the stress deviator and the direction of this deviator; it holds p, and holds the four other deviatoric
stresses at zero. The direction turns about y in small steps; the principal stresses remain those of triaxial
compression.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

import labkit as lk
from labkit.paths import NORM, Here, Step, StrainMeasure, StrainReached

COMPRESSION = np.diag([-0.5, -0.5, 1.0])  # strain rate over its axial component
STEP = 2.0  # degrees by which the direction turns in each step


@lk.register_path
@dataclasses.dataclass(frozen=True)
class CriticalRotation(lk.StressPath):
    """Shear along sigma_1, whose axis rotates about y by `rotation` over the first part of the strain."""

    strain: float = lk.parameter(0.8, above=0.0, high=10.0, help="strain along sigma_1")
    rotation: float = lk.parameter(180.0, low=0.0, high=3600.0, help="angle of rotation of sigma_1, degrees")
    rotation_strain: float = lk.parameter(0.5, above=0.0, high=10.0, help="strain over which sigma_1 rotates")

    name = "critical_rotation"
    axisymmetric = False
    figure = "pi_plane"

    def strain_measure(self) -> StrainMeasure:
        return NORM

    def start_pressure(self) -> float | None:
        return None  # the specimen keeps its stress

    def flow(self, travelled: float) -> np.ndarray:
        return COMPRESSION

    def control(self) -> lk.Control | None:
        return self.along(0.0, self.strain).held

    def held(self) -> tuple[lk.Held, ...]:
        return (lk.Held("mean stress", "stress", np.eye(3)[None] / 3.0, np.array([self.held_pressure])),)

    def steps_from(self, start: Here) -> Iterable[Step]:
        """Yield a step for every direction."""
        turns = round(self.rotation / STEP)
        for turn in range(1, turns + 1):
            yield self.along(turn * STEP, self.rotation_strain / turns)
        rest = self.strain - (self.rotation_strain if turns else 0.0)
        if rest > 0.0:
            yield self.along(turns * STEP, rest)

    def along(self, angle: float, length: float) -> Step:
        """Return the step with sigma_1 at `angle` degrees from z over a strain of `length`."""
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        flow, *others = (lk.micro.symmetric(turn @ one @ turn.T) for one in (COMPRESSION, *across_compression()))
        measure = [np.eye(3) / 3.0, *others]
        control = lk.Control(measure, [np.eye(3), *others], [self.held_pressure, 0.0, 0.0, 0.0, 0.0])
        return Step(flow, control, StrainReached(length), self.rate_limit)


def across_compression() -> list[np.ndarray]:
    """The four symmetric tensors without trace that are normal to compression along z."""
    axes = np.eye(3)
    products = [np.outer(axes[i], axes[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    return [np.diag([1.0, -1.0, 0.0]), *(product + product.T for product in products)]
