"""The limits of section 2, within which a test is quasi-static and its contacts are small."""

from __future__ import annotations

import numpy as np

from labkit.micro.stress import mean_stress

PRESSURE_LIMIT = 3e6  # Pa
OVERLAP_LIMIT = 0.02  # mean delta/D
INERTIAL_LIMIT = 3e-4
GRAINS_LIMIT = (13_800, 15_000)  # in a cube of 4 mm
DRIFT_LIMIT = 0.01  # share of the kinetic energy that is motion of the whole


def exceeded(run):
    """Where a run left the limits: a list of sentences. `run`: name -> array of the recorded variables."""
    found = []
    for what, values, limit in (
        ("inertial number", run["inertial_number"], INERTIAL_LIMIT),
        ("mean overlap", run["overlap_ratio"], OVERLAP_LIMIT),
        ("mean stress in Pa", mean_stress(np.asarray(run["stress"])), PRESSURE_LIMIT),
    ):
        values = np.asarray(values)
        beyond = np.flatnonzero(values > limit)
        if len(beyond):
            strain = np.asarray(run["axial_strain"])[beyond]
            found.append(
                f"{what} above {limit:g} at {len(beyond)} of {len(values)} records, axial strain "
                f"{strain.min():.2%} to {strain.max():.2%}, at most {values[beyond].max():.3g}"
            )
    return found
