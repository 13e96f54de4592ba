"""One record of a run: everything that a run file holds about one instant, computed from a State."""

from __future__ import annotations

from typing import Any

import numpy as np

from labkit.dem.observed import logarithmic_strain as logarithmic_strain
from labkit.dem.observed import observe, record_of
from labkit.dem.recorded import recorded
from labkit.dem.state import State
from labkit.micro.snapshot import Snapshot


def measure(state: State, first_cell: np.ndarray, snapshot: Snapshot | None = None) -> dict[str, Any]:
    """The variables of labkit.dem.recorded.record_table for one State, name -> value.

    `first_cell` (3, 3), m: the cell at zero strain. `snapshot`: the Snapshot of the state, if already computed.
    """
    snapshot = snapshot or state.snapshot()
    record = record_of(state, observe(state, snapshot), first_cell)
    return {**record, **{statistic.name: statistic(snapshot) for statistic in recorded()}}
