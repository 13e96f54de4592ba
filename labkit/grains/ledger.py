"""The ledger: work done on the cell and energy dissipated since the energy balance was opened."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping


@dataclasses.dataclass(frozen=True)
class Ledger:
    """Energies (J) since the ledger was opened (labkit.records.energy).

    Args:
        start: Energy stored when the ledger was opened.
        cell_work: Work done on the cell.
        friction_loss: Energy dissipated by friction.
        rolling_loss: Energy dissipated by rolling.
        damping_loss: Energy dissipated by local damping or dashpots.
        further: Energies dissipated by other parts of the contact law: name -> J.
    """

    start: float = 0.0
    cell_work: float = 0.0
    friction_loss: float = 0.0
    rolling_loss: float = 0.0
    damping_loss: float = 0.0
    further: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def without_losses(self) -> bool:
        """True if the engine sums the work on the cell but not the losses: all losses are then NaN."""
        return math.isnan(self.friction_loss) and math.isfinite(self.cell_work)

    @property
    def total_loss(self) -> float:
        """Sum of all losses."""
        return sum(self.further.values(), self.friction_loss + self.rolling_loss + self.damping_loss)

    def plus(
        self,
        cell_work: float,
        friction_loss: float = 0.0,
        rolling_loss: float = 0.0,
        damping_loss: float = 0.0,
        further: Mapping[str, float] | None = None,
    ) -> Ledger:
        """Return a copy with the given work and losses added."""
        added = further or {}
        return Ledger(
            self.start,
            self.cell_work + cell_work,
            self.friction_loss + friction_loss,
            self.rolling_loss + rolling_loss,
            self.damping_loss + damping_loss,
            {name: self.further.get(name, 0.0) + added.get(name, 0.0) for name in {**self.further, **added}},
        )
