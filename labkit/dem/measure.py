"""One record of a run: everything a run file holds about one instant, from a State."""

from __future__ import annotations

import numpy as np

from labkit.dem.energy import balance_error
from labkit.micro import indicators, void_ratio
from labkit.micro.contacts import contacts_of
from labkit.micro.fabric import statistics
from labkit.micro.stress import love_stress, mean_stress
from labkit.sff.c0 import sff_stress


def logarithmic_strain(cell, first_cell):
    """Hencky strain -1/2 ln(F F^T), F = H H0^-1; shape (3, 3), compression positive. Cells (3, 3), m."""
    F = cell @ np.linalg.inv(first_cell)
    squared, direction = np.linalg.eigh(F @ F.T)
    return -(direction * (0.5 * np.log(squared))) @ direction.T


def measure(state, first_cell, contacts=None):
    """The variables of labkit.io.schema.RECORD for one State, name -> value.

    `first_cell` (3, 3), m: the cell at zero strain. `contacts`: those of the state, if at hand.
    """
    contacts = contacts_of(state) if contacts is None else contacts
    scene, radius, grains = state.scene, state.radius, state.number_of_grains
    strain = logarithmic_strain(state.cell, first_cell)
    stress = love_stress(contacts, radius, state.volume)
    nominal = void_ratio.void_ratio_nominal(radius, state.volume)
    fabric = statistics(contacts, radius, scene.young_modulus)
    rate = 0.5 * (state.velocity_gradient + state.velocity_gradient.T)
    return {
        "time": state.time,
        "axial_strain": strain[2, 2],
        "strain": strain,
        "cell": state.cell,
        "volume": state.volume,
        "stress": stress,
        "stress_sff": sff_stress(
            scene.young_modulus, fabric.coordination_number, fabric.mean_normalised_force, nominal,
            fabric.contact_anisotropy, fabric.normal_force_anisotropy, fabric.mobilisation,
        ),
        "void_ratio": void_ratio.void_ratio(radius, state.volume, contacts),
        "void_ratio_nominal": nominal,
        "coordination_number": fabric.coordination_number,
        "contact_anisotropy": fabric.contact_anisotropy,
        "mean_normalised_force": fabric.mean_normalised_force,
        "normal_force_anisotropy": fabric.normal_force_anisotropy,
        "mobilisation": fabric.mobilisation,
        "inertial_number": indicators.inertial_number(
            rate, mean_stress(stress), 2.0 * radius.mean(), scene.density
        ),
        "overlap_ratio": indicators.overlap_ratio(radius, contacts),
        "rattler_fraction": indicators.rattler_fraction(grains, contacts),
        "kinetic_energy": indicators.kinetic_energy(state),
        "unbalanced_force": indicators.unbalanced_force(grains, contacts),
        "elastic_energy": indicators.elastic_energy(scene, radius, contacts),
        "cell_work": state.ledger.cell_work,
        "friction_loss": state.ledger.friction_loss,
        "rolling_loss": state.ledger.rolling_loss,
        "damping_loss": state.ledger.damping_loss,
        "energy_balance_error": balance_error(state, contacts),
        "drift_velocity": indicators.drift_velocity(state),
    }  # fmt: skip
