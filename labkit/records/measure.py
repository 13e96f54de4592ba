"""Computes one record of a run, everything that a run file holds about one instant, from a State."""

from __future__ import annotations

import numpy as np

from labkit.grains.state import State
from labkit.micro import indicators
from labkit.micro.fabric import statistics
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.void_ratio import grain_volume, lenses
from labkit.quantities.recorded import recorded
from labkit.records.energy import drift_velocity, kinetic_energy, relative_balance
from labkit.sff.c0 import c0_of


def measure(state: State, first_cell: np.ndarray, snapshot: Snapshot | None = None) -> dict[str, object]:
    """Compute the variables of labkit.quantities.recorded.record_table for one State, name -> value.

    Args:
        state: The State.
        first_cell: Cell at zero strain, (3, 3), m.
        snapshot: Snapshot of the state, if already computed.
    """
    snapshot = snapshot or state.snapshot()
    scene, ledger, fabric = state.scene, state.ledger, statistics(snapshot)
    strain, stress = logarithmic_strain(state.cell, first_cell), love_stress(snapshot)
    rate = 0.5 * (state.velocity_gradient + state.velocity_gradient.T)
    pressure, solid = float(mean_stress(stress)), grain_volume(snapshot.radius)
    nominal = state.volume / solid - 1.0
    kinetic, elastic = kinetic_energy(state), indicators.elastic_energy(snapshot)
    record = {
        "time": state.time,
        "axial_strain": strain[2, 2],
        "strain": strain,
        "cell": state.cell,
        "volume": state.volume,
        "stress": stress,
        "stress_sff": c0_of(fabric, scene.young_modulus, nominal),
        "void_ratio": state.volume / (solid - lenses(snapshot)) - 1.0,
        "void_ratio_nominal": nominal,
        **vars(fabric),
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
        "breaking_loss": ledger.breaking_loss,
        "energy_balance_error": relative_balance(ledger, kinetic + elastic),
        "drift_velocity": drift_velocity(state),
    }
    return {**record, **{statistic.name: statistic(snapshot) for statistic in recorded()}}


def logarithmic_strain(cell: np.ndarray, first_cell: np.ndarray) -> np.ndarray:
    """Hencky strain -1/2 ln(F F^T), F = H H0^-1, of two cells (3, 3), m; (3, 3), compression positive."""
    F = cell @ np.linalg.inv(first_cell)
    squared, direction = np.linalg.eigh(F @ F.T)
    return -(direction * (0.5 * np.log(squared))) @ direction.T
