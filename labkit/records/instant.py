"""One instant of a run, and the record of this instant for the run file."""

from __future__ import annotations

import functools

import numpy as np

from labkit.grains.state import State
from labkit.micro import indicators
from labkit.micro.fabric import statistics, statistics_by_volume
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.quantities.recorded import recorded_statistics
from labkit.records.energy import drift_velocity, kinetic_energy, relative_balance
from labkit.servo.correction import cell_stiffness
from labkit.sff.c0 import sff_stress, sff_stress_by_volume


class Instant:
    """One instant of a run, computed from a State."""

    def __init__(self, state: State) -> None:
        """Store the State."""
        self.state = state

    @functools.cached_property
    def snapshot(self) -> Snapshot:
        """The Snapshot of the State."""
        return self.state.snapshot()

    @functools.cached_property
    def stress(self) -> np.ndarray:
        """Love's stress, (3, 3), in Pa."""
        return love_stress(self.snapshot)

    def stiffness(self, components: int) -> np.ndarray:
        """Return the stiffness of the cell (labkit.servo.correction.cell_stiffness), in Pa."""
        return cell_stiffness(self.snapshot, components)

    def measure(self, first_cell: np.ndarray) -> dict[str, object]:
        """Return the values of the variables in labkit.quantities.recorded.record_table by name.

        `first_cell` (3, 3), in m, is the cell at zero strain.
        """
        state, snapshot = self.state, self.snapshot
        scene, ledger = state.scene, state.ledger
        fabric, by_volume = statistics(snapshot), statistics_by_volume(snapshot)
        strain, stress = logarithmic_strain(state.cell, first_cell), self.stress
        rate = 0.5 * (state.velocity_gradient + state.velocity_gradient.T)
        pressure = float(mean_stress(stress))
        kinetic, elastic = kinetic_energy(state), indicators.elastic_energy(snapshot)
        record = {
            "time": state.time,
            "axial_strain": strain[2, 2],
            "strain": strain,
            "cell": state.cell,
            "volume": snapshot.volume,
            "stress": stress,
            "stress_sff": sff_stress(snapshot, fabric),
            "stress_sff_by_volume": sff_stress_by_volume(snapshot, by_volume),
            "mean_normalised_force_by_volume": by_volume.mean_normalised_force,
            "void_ratio": void_ratio(snapshot),
            "void_ratio_nominal": void_ratio_nominal(snapshot),
            **fabric.by_name(),
            "inertial_number": indicators.inertial_number(rate, pressure, 2.0 * snapshot.radius.mean(), scene.density),
            "overlap_ratio": indicators.overlap_ratio(snapshot),
            "rattler_fraction": indicators.rattler_fraction(snapshot),
            "kinetic_energy": kinetic,
            "unbalanced_force": indicators.unbalanced_force(snapshot),
            "elastic_energy": elastic,
            "cell_work": ledger.cell_work,
            "friction_loss": ledger.friction_loss,
            "rolling_loss": ledger.rolling_loss,
            "damping_loss": ledger.damping_loss,
            **dict.fromkeys(scene.contact_law.losses, 0.0),
            **ledger.further,
            "energy_balance_error": relative_balance(ledger, kinetic + elastic),
            "drift_velocity": drift_velocity(state),
        }
        return {**record, **{statistic.name: statistic(snapshot) for statistic in recorded_statistics()}}


def logarithmic_strain(cell: np.ndarray, first_cell: np.ndarray) -> np.ndarray:
    """Return the Hencky strain -1/2 ln(F F^T), (3, 3), with F = H H0^-1 of two cells (3, 3); compression positive."""
    F = cell @ np.linalg.inv(first_cell)
    squared, direction = np.linalg.eigh(F @ F.T)
    return -(direction * (0.5 * np.log(squared))) @ direction.T
