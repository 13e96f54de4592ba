"""An engine at one instant of a run, whose grains are fetched only when needed."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from labkit.grains.state import State
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.records.measure import measure
from labkit.servo.correction import cell_stiffness


class Instant:
    """One instant, from a State.

    `brief` is the State. An engine on a GPU may leave out its grains and contacts, which are fetched on first use.
    """

    def __init__(self, brief: State, complete: Callable[[], State] | None = None) -> None:
        """Take the State and, if it lacks arrays, a function that completes it on first use."""
        self.brief, self._complete = brief, complete

    @property
    def state(self) -> State:
        """The complete State."""
        if self._complete is not None:
            self.brief, self._complete = self._complete(), None
        return self.brief

    @functools.cached_property
    def snapshot(self) -> Snapshot:
        """The Snapshot of the State."""
        return self.state.snapshot()

    def stress(self) -> np.ndarray:
        """Love's stress, (3, 3), Pa."""
        return love_stress(self.snapshot)

    def stiffness(self, components: int) -> np.ndarray:
        """Stiffness of the cell (labkit.servo.correction.cell_stiffness), Pa."""
        return cell_stiffness(self.snapshot, components)

    def measure(self, first_cell: np.ndarray) -> dict[str, object]:
        """The variables of a record (labkit.records.measure)."""
        return measure(self.state, first_cell, self.snapshot)
