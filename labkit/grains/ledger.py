"""Ledger: work on the cell and losses since the energy balance was opened."""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Ledger:
    """Energies since the ledger was opened, J (labkit.records.energy).

    Args:
        start: Energy stored when the ledger was opened.
        cell_work: Work done on the cell.
        friction_loss: Energy dissipated by friction.
        rolling_loss: Energy dissipated by rolling.
        damping_loss: Energy dissipated by local damping or dashpots.
        breaking_loss: Energy lost where grains joined or parted and where bonds broke.
    """

    start: float = 0.0
    cell_work: float = 0.0
    friction_loss: float = 0.0
    rolling_loss: float = 0.0
    damping_loss: float = 0.0
    breaking_loss: float = 0.0

    @property
    def without_losses(self) -> bool:
        """True if the engine sums the work on the cell but no losses, which are then NaN."""
        return math.isnan(self.friction_loss) and math.isfinite(self.cell_work)

    def plus(self, *flows: float) -> Ledger:
        """Return a copy with the given work and losses added, in the order of the fields."""
        start, *sums = vars(self).values()
        flows += (0.0,) * (len(sums) - len(flows))
        return Ledger(start, *(a + float(b) for a, b in zip(sums, flows, strict=True)))
