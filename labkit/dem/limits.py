"""The limits of section 2, within which a test is quasi-static and its contacts are small."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from labkit.dem.state import State
from labkit.errors import InputError
from labkit.micro.indicators import overlap_ratio
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, mean_stress

PRESSURE_LIMIT = 3e6  # Pa
OVERLAP_LIMIT = 0.02  # mean delta/D
OVERLAP_END = 0.1  # mean delta/D at which a specimen is no specimen: random insertion leaves 0.2, e = 0.3 makes 0.053
INERTIAL_LIMIT = 3e-4
GRAINS_LIMIT = (13_800, 15_000)  # in a cube of 4 mm
DRIFT_LIMIT = 0.01  # share of the kinetic energy that is motion of the whole

RECORDED = ("axial_strain", "inertial_number", "overlap_ratio", "stress")  # what exceeded() looks at


def exceeded(run: Mapping[str, np.ndarray]) -> list[str]:
    """Where a run left the limits: a list of sentences. `run`: name -> array of the variables RECORDED."""
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


def exceeded_by(state: State) -> list[str]:
    """Where a specimen is outside the limits before any test: a list of sentences."""
    snapshot = state.snapshot()
    return [
        f"{what} {value:.3g} is above {limit:g}"
        for what, value, limit in (
            ("mean overlap", overlap_ratio(snapshot), OVERLAP_LIMIT),
            ("mean stress in Pa", mean_stress(love_stress(snapshot)), PRESSURE_LIMIT),
        )
        if value > limit
    ]


def require_shallow(snapshot: Snapshot) -> None:
    """Raises InputError if grains overlap as where they were put at random, and not as pressure makes them."""
    overlap = overlap_ratio(snapshot)
    if overlap > OVERLAP_END:
        raise InputError(
            f"the grains overlap by {overlap:.0%} of their diameter on average, too deep for the contact law: let them "
            f"come to rest below {OVERLAP_END:.0%} first, as labkit specimen does"
        )
