"""An engine at one instant of a run: what the run asks of it, without the grains as long as nobody needs them."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from labkit.dem.measure import measure
from labkit.dem.servo import cell_stiffness
from labkit.dem.state import State
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress


class Instant:
    """One instant, from a State. An engine whose grains are on several ranks has its own subclass.

    `brief` is the State, of which such an engine may leave out the grains and the contacts, and an engine on a GPU may
    do so until a method of the Instant has needed them.
    """

    def __init__(self, brief: State) -> None:
        """brief: the State."""
        self.brief = brief

    @property
    def state(self) -> State:
        """The complete State."""
        return self.brief

    @functools.cached_property
    def snapshot(self) -> Snapshot:
        """The Snapshot of the State."""
        return self.state.snapshot()

    def stress(self) -> np.ndarray:
        """Love's stress, (3, 3), Pa."""
        return love_stress(self.snapshot)

    def stiffness(self, components: int) -> np.ndarray:
        """Stiffness of the cell (labkit.dem.servo.cell_stiffness), Pa."""
        return cell_stiffness(self.snapshot, components)

    def measure(self, first_cell: np.ndarray) -> dict[str, Any]:
        """The variables of a record (labkit.dem.measure)."""
        return measure(self.state, first_cell, self.snapshot)
