"""One record of a run: everything that a run file holds about one instant, computed from a State."""

from __future__ import annotations

from typing import Any

import numpy as np

from labkit.dem.energy import balance_error, drift_velocity, kinetic_energy
from labkit.dem.recorded import recorded
from labkit.dem.state import State
from labkit.micro import indicators
from labkit.micro.fabric import statistics
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, mean_stress
from labkit.micro.void_ratio import void_ratio, void_ratio_nominal
from labkit.sff.c0 import c0_stress


def logarithmic_strain(cell: np.ndarray, first_cell: np.ndarray) -> np.ndarray:
    """Hencky strain -1/2 ln(F F^T), F = H H0^-1; shape (3, 3), compression positive. Cells (3, 3), m."""
    F = cell @ np.linalg.inv(first_cell)
    squared, direction = np.linalg.eigh(F @ F.T)
    return -(direction * (0.5 * np.log(squared))) @ direction.T


def measure(state: State, first_cell: np.ndarray, snapshot: Snapshot | None = None) -> dict[str, Any]:
    """The variables of labkit.dem.recorded.record_table for one State, name -> value.

    `first_cell` (3, 3), m: the cell at zero strain. `snapshot`: the Snapshot of the state, if already computed.
    """
    snapshot = snapshot or state.snapshot()
    scene, radius = state.scene, state.radius
    strain = logarithmic_strain(state.cell, first_cell)
    stress = love_stress(snapshot)
    pressure = float(mean_stress(stress))
    nominal = void_ratio_nominal(snapshot)
    fabric = statistics(snapshot)
    kinetic, elastic = kinetic_energy(state), indicators.elastic_energy(snapshot)
    rate = 0.5 * (state.velocity_gradient + state.velocity_gradient.T)
    return {
        "time": state.time,
        "axial_strain": strain[2, 2],
        "strain": strain,
        "cell": state.cell,
        "volume": state.volume,
        "stress": stress,
        "stress_sff": c0_stress(
            scene.young_modulus,
            fabric.coordination_number,
            fabric.mean_normalised_force,
            nominal,
            fabric.contact_anisotropy,
            fabric.normal_force_anisotropy,
            fabric.mobilisation,
        ),
        "void_ratio": void_ratio(snapshot),
        "void_ratio_nominal": nominal,
        "coordination_number": fabric.coordination_number,
        "contact_anisotropy": fabric.contact_anisotropy,
        "mean_normalised_force": fabric.mean_normalised_force,
        "normal_force_anisotropy": fabric.normal_force_anisotropy,
        "mobilisation": fabric.mobilisation,
        "inertial_number": indicators.inertial_number(rate, pressure, 2.0 * radius.mean(), scene.density),
        "overlap_ratio": indicators.overlap_ratio(snapshot),
        "rattler_fraction": indicators.rattler_fraction(snapshot),
        "kinetic_energy": kinetic,
        "unbalanced_force": indicators.unbalanced_force(snapshot),
        "elastic_energy": elastic,
        "cell_work": state.ledger.cell_work,
        "friction_loss": state.ledger.friction_loss,
        "rolling_loss": state.ledger.rolling_loss,
        "damping_loss": state.ledger.damping_loss,
        "energy_balance_error": balance_error(state, snapshot, kinetic + elastic),
        "drift_velocity": drift_velocity(state),
        **{statistic.name: statistic(snapshot) for statistic in recorded()},
    }
