"""The limits of section 2, within which a test is quasi-static and its contacts are small."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping

import numpy as np

from labkit.dem.paths import Path
from labkit.dem.scene import Scene
from labkit.dem.state import State
from labkit.errors import InputError
from labkit.io.files import open_netcdf
from labkit.micro.indicators import overlap_ratio
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import love_stress, mean_stress

STRESS_LIMIT = 0.02  # mean stress over E, 3 MPa for Table 1's grains: there the mean overlap reaches its limit
OVERLAP_LIMIT = 0.02  # mean delta/D
OVERLAP_END = 0.1  # mean delta/D at which a specimen is no specimen: random insertion leaves 0.2, e = 0.3 makes 0.053
INERTIAL_LIMIT = 3e-4
GRAINS_LIMIT = (13_800, 15_000)  # in a cube of 4 mm
DRIFT_LIMIT = 0.01  # share of the kinetic energy that is motion of the whole

RECORDED = ("axial_strain", "inertial_number", "overlap_ratio", "stress")  # what exceeded() looks at


@dataclasses.dataclass(frozen=True)
class Exceeded:
    """A limit that a run or a specimen has exceeded. records: at how many of `of`; strain: the first and the last axial
    strain of these; largest: value there. A specimen has no records.
    """

    name: str
    limit: float
    largest: float
    records: int = 0
    of: int = 0
    strain: tuple[float, float] = (0.0, 0.0)

    def __str__(self) -> str:
        if not self.of:
            return f"{self.name} {self.largest:.3g} is above {self.limit:g}"
        return (
            f"{self.name} above {self.limit:g} at {self.records} of {self.of} records, axial strain "
            f"{self.strain[0]:.2%} to {self.strain[1]:.2%}, at most {self.largest:.3g}"
        )


def pressure_limit(scene: Scene) -> float:
    """Mean stress, Pa, up to which overlaps stay small: 0.02 E."""
    return STRESS_LIMIT * scene.young_modulus


def require_pressure(path: Path, scene: Scene) -> None:
    """Raises InputError if the path holds or seeks a pressure at which grains of this scene overlap too much."""
    pressure, limit = path.parameters().get("pressure"), pressure_limit(scene)
    if pressure is not None and pressure > limit * (1.0 + 1e-12):
        said = f"Pa is not possible for grains of E = {scene.young_modulus:g} Pa"
        allowed = f"at most {limit:g} Pa, where the mean overlap reaches its limit of {100 * OVERLAP_LIMIT:g} %"
        raise InputError(said, field="pressure", value=pressure, allowed=allowed)


def exceeded(run: Mapping[str, np.ndarray], scene: Scene) -> tuple[Exceeded, ...]:
    """Where a run left the limits. `run`: name -> array of the variables RECORDED."""
    found = []
    for name, values, limit in (
        ("inertial number", run["inertial_number"], INERTIAL_LIMIT),
        ("mean overlap", run["overlap_ratio"], OVERLAP_LIMIT),
        ("mean stress in Pa", mean_stress(np.asarray(run["stress"])), pressure_limit(scene)),
    ):
        values = np.asarray(values)
        beyond = np.flatnonzero(values > limit)
        if len(beyond):
            strain = np.asarray(run["axial_strain"])[beyond]
            ends = float(strain.min()), float(strain.max())
            found.append(Exceeded(name, limit, float(values[beyond].max()), len(beyond), len(values), ends))
    return tuple(found)


def exceeded_in(file: str | os.PathLike[str]) -> tuple[Exceeded, ...]:
    """Where the run in a file left the limits. Raises InputError if it is not a run file."""
    with open_netcdf(file, "run") as dataset:
        known = {name: dataset[name][...].filled(np.nan) for name in RECORDED if name in dataset.variables}
        known |= {name: np.zeros(0) for name in RECORDED if name not in known}
        return exceeded(known, Scene.from_json(dataset.scene))


def exceeded_by(state: State) -> tuple[Exceeded, ...]:
    """Where a specimen is outside the limits before any test."""
    snapshot = state.snapshot()
    return tuple(
        Exceeded(name, limit, float(value))
        for name, value, limit in (
            ("mean overlap", overlap_ratio(snapshot), OVERLAP_LIMIT),
            ("mean stress in Pa", mean_stress(love_stress(snapshot)), pressure_limit(state.scene)),
        )
        if value > limit
    )


def require_shallow(snapshot: Snapshot) -> None:
    """Raises InputError if grains overlap as where they were put at random, and not as pressure makes them."""
    overlap = overlap_ratio(snapshot)
    if overlap > OVERLAP_END:
        raise InputError(
            f"the grains overlap by {overlap:.0%} of their diameter on average, too deep for the contact law: let them "
            f"come to rest below {OVERLAP_END:.0%} first, as labkit specimen does"
        )
