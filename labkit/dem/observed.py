"""What a record needs of one instant, and the record made of it.

An engine that holds all grains in one process finds it from a State. One whose grains are on several ranks finds it
from a part of the grains on each rank: all quantities are sums over contacts and grains, or follow from such sums.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from labkit.dem.energy import drift_velocity, kinetic_energy, relative_balance
from labkit.dem.state import State
from labkit.micro import indicators
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, mean_stress
from labkit.micro.void_ratio import grain_volume, lenses
from labkit.sff.c0 import c0_stress


@dataclasses.dataclass(frozen=True)
class Observed:
    """Quantities of one instant in SI units; the statistics are those of labkit.micro.

    grain_volume: total; lens_volume: of all overlaps; kinetic_energy: relative to the mean field; drift_velocity (3,).
    """

    stress: np.ndarray
    fabric: Statistics
    grain_volume: float
    lens_volume: float
    overlap_ratio: float
    rattler_fraction: float
    kinetic_energy: float
    elastic_energy: float
    unbalanced_force: float
    drift_velocity: np.ndarray


def observe(state: State, snapshot: Snapshot) -> Observed:
    """The quantities of a State, of which `snapshot` is the Snapshot."""
    return Observed(
        love_stress(snapshot),
        statistics(snapshot),
        grain_volume(state.radius),
        lenses(snapshot),
        indicators.overlap_ratio(snapshot),
        indicators.rattler_fraction(snapshot),
        kinetic_energy(state),
        indicators.elastic_energy(snapshot),
        indicators.unbalanced_force(snapshot),
        drift_velocity(state),
    )


def record_of(state: State, seen: Observed, first_cell: np.ndarray) -> dict[str, Any]:
    """The variables of labkit.io.schema.RECORD, name -> value.

    Of the state, only radii, cell, velocity gradient, time and ledger are used. `first_cell` (3, 3), m: the cell at
    zero strain.
    """
    scene, fabric = state.scene, seen.fabric
    strain = logarithmic_strain(state.cell, first_cell)
    pressure = float(mean_stress(seen.stress))
    nominal = state.volume / seen.grain_volume - 1.0
    rate = 0.5 * (state.velocity_gradient + state.velocity_gradient.T)
    stored = seen.kinetic_energy + seen.elastic_energy
    return {
        "time": state.time,
        "axial_strain": strain[2, 2],
        "strain": strain,
        "cell": state.cell,
        "volume": state.volume,
        "stress": seen.stress,
        "stress_sff": c0_stress(
            scene.young_modulus,
            fabric.coordination_number,
            fabric.mean_normalised_force,
            nominal,
            fabric.contact_anisotropy,
            fabric.normal_force_anisotropy,
            fabric.mobilisation,
        ),
        "void_ratio": state.volume / (seen.grain_volume - seen.lens_volume) - 1.0,
        "void_ratio_nominal": nominal,
        "coordination_number": fabric.coordination_number,
        "contact_anisotropy": fabric.contact_anisotropy,
        "mean_normalised_force": fabric.mean_normalised_force,
        "normal_force_anisotropy": fabric.normal_force_anisotropy,
        "mobilisation": fabric.mobilisation,
        "inertial_number": indicators.inertial_number(rate, pressure, 2.0 * state.radius.mean(), scene.density),
        "overlap_ratio": seen.overlap_ratio,
        "rattler_fraction": seen.rattler_fraction,
        "kinetic_energy": seen.kinetic_energy,
        "unbalanced_force": seen.unbalanced_force,
        "elastic_energy": seen.elastic_energy,
        "cell_work": state.ledger.cell_work,
        "friction_loss": state.ledger.friction_loss,
        "rolling_loss": state.ledger.rolling_loss,
        "damping_loss": state.ledger.damping_loss,
        "energy_balance_error": relative_balance(state.ledger, stored),
        "drift_velocity": seen.drift_velocity,
    }


def logarithmic_strain(cell: np.ndarray, first_cell: np.ndarray) -> np.ndarray:
    """Hencky strain -1/2 ln(F F^T), F = H H0^-1; shape (3, 3), compression positive. Cells (3, 3), m."""
    F = cell @ np.linalg.inv(first_cell)
    squared, direction = np.linalg.eigh(F @ F.T)
    return -(direction * (0.5 * np.log(squared))) @ direction.T
