"""A leg of a loading path: what moves the cell until the path reverses, or until its next step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from labkit.dem.control import Control

if TYPE_CHECKING:
    from labkit.dem.loading import Path


@dataclasses.dataclass(frozen=True, eq=False)
class Leg:
    """A leg of a path: what moves the cell until the path reverses, or until its next step.

    path: the path; sign: of the strain rate; first: number of the time step from which `travelled` is counted; pace:
    the strain rate divided by the rate of the path.
    """

    path: Path
    sign: float
    first: int = 0
    pace: float = 1.0

    restarts: ClassVar[bool] = False  # True if the accumulated strain is counted from the start of the leg

    @property
    def rests(self) -> bool:
        """True if neither strains nor stresses change, so that a material without viscosity stays as it is."""
        return False

    @property
    def name(self) -> str:
        """Name of the path."""
        return self.path.name

    @property
    def axial_rate(self) -> float:
        """Axial strain rate, 1/s."""
        return self.pace * self.path.axial_rate

    @property
    def rate_limit(self) -> float:
        """Largest strain rate of the servo, divided by the axial rate."""
        return self.path.rate_limit

    def flow(self, travelled: float) -> np.ndarray:
        """The prescribed velocity gradient divided by the rate, (3, 3); see Path.flow."""
        return self.path.flow(travelled)

    def control(self) -> Control | None:
        """The Control of the servo; None if all strain rates are prescribed."""
        return self.path.control()

    @property
    def varies(self) -> bool:
        """True if the prescribed rates or the held stresses change with the accumulated strain."""
        return self.path.varies

    def next_change(self, travelled: float) -> float:
        """Accumulated strain at which the prescribed rates next change abruptly."""
        return math.inf

    def stops(self, record: Mapping[str, Any], first: Mapping[str, Any]) -> bool:
        """True if the leg ends at a record; `first`: the first record of the run."""
        return False

    def settled(self, stress: np.ndarray, travelled: float) -> np.ndarray:
        """The stress (3, 3), Pa, at which the next leg starts, given the one measured at the end of this one."""
        return stress

    def progress(self, travelled: float) -> Mapping[str, float]:
        """Values of Path.recorded at a record."""
        return {}

    def lost(self, stress: np.ndarray, travelled: float) -> str:
        """Why a held stress no longer follows its target, one sentence; empty if it does. stress: (3, 3), Pa."""
        return ""

    @property
    def label(self) -> str:
        """Name of the leg at the start of a message, with a colon; empty if the path has no names for them."""
        return ""
