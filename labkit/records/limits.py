"""The limits of section 2, within which a test is quasi-static and contact overlaps are small."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterator

import numpy as np

from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.io.netcdf import open_netcdf
from labkit.micro.cells import relative_width
from labkit.micro.indicators import inertial_number, overlap_ratio
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.parameters import parameters_of
from labkit.paths.path import Path
from labkit.paths.programme import PROGRESS
from labkit.paths.rates import on_grains, rate_of
from labkit.paths.registry import path_of
from labkit.paths.step import Here, Step
from labkit.paths.steps import Steps, stress_errors
from labkit.quantities.scalars import Record

STRESS_LIMIT = 0.02  # mean stress over E, 3 MPa for Table 1: the mean overlap then reaches its limit
OVERLAP_LIMIT = 0.02  # mean delta/D
OVERLAP_END = 0.1  # mean delta/D of an unrelaxed specimen: 0.2 after random insertion, 0.053 at rest with e = 0.3
INERTIAL_LIMIT = 3e-4
SAFE = 0.7  # fraction of the rate expected to reach the limit: numbers of dilating specimens were up to a fifth higher
GRAINS_LIMIT = (13_800, 15_000)  # grains in a cube of 4 mm
SMALL, LARGE = 1e-6, 0.1  # m
WIDE = 10.0  # smallest width of a cell divided by the diameter of its largest grain
DRIFT_LIMIT = 0.01  # share of the motion of the centre of mass in the kinetic energy

HELD_RMS, HELD_WORST = 0.005, 0.02  # relative errors of the stress held by a path
HELD_AFTER = 0.005  # accumulated axial strain from which a held stress is checked

ALWAYS = ("axial_strain", "inertial_number", "overlap_ratio", "stress")  # variables that exceeded_limits() checks
RECORDED = (*ALWAYS, "time", "accumulated_strain", *PROGRESS)  # including those needed for held stresses
SHOWN_IN = {"": 1.0, "%": 100.0, "MPa": 1e-6}  # unit of a value in a sentence -> factor on a fraction or Pa


@dataclasses.dataclass(frozen=True)
class Exceeded:
    """A limit that a run or a specimen exceeds.

    A run exceeds it at a number of `records`, out of `of`, whose axial `strain` ranges from the first to the second
    value; `largest` is the largest value. For a specimen `records`, `of` and `strain` are zero. The sentence has both
    values in the unit `shown_in`, one of SHOWN_IN.
    """

    name: str
    limit: float
    largest: float
    records: int = 0
    of: int = 0
    strain: tuple[float, float] = (0.0, 0.0)
    shown_in: str = ""

    def __str__(self) -> str:
        factor, unit = SHOWN_IN[self.shown_in], f" {self.shown_in}".rstrip()
        limit, largest = f"{factor * self.limit:g}{unit}", f"{factor * self.largest:.3g}{unit}"
        if not self.of:
            return f"a {self.name} of {largest} is above the limit of {limit}"
        return (
            f"the {self.name} is above the limit of {limit} at {self.records} of {self.of} records, at axial strains "
            f"from {self.strain[0]:.2%} to {self.strain[1]:.2%}; its largest value is {largest}"
        )


def pressure_limit(scene: Scene) -> float:
    """Mean stress up to which overlaps stay small, 0.02 E, Pa."""
    return STRESS_LIMIT * scene.young_modulus


def require_pressure(path: Path, scene: Scene) -> None:
    """Raise InputError if the path holds or reaches a pressure at which grains of this scene overlap too much."""
    limit = pressure_limit(scene)
    for name, pressure in _prescribed_stresses(path).items():
        if pressure <= limit * (1.0 + 1e-12):
            continue
        problem = f"Pa is too high for grains with E = {scene.young_modulus:g} Pa"
        allowed = (
            f"at most {limit:g} Pa, where the mean overlap reaches its limit of {100 * OVERLAP_LIMIT:g} %, "
            f"or use grains with E of at least {pressure / STRESS_LIMIT:g} Pa"
        )
        if name not in parameters_of(type(path)):  # a step of the path
            raise InputError(f"{name}: {pressure:g} {problem}: give {allowed}")
        raise InputError(problem, field=name, value=float(pressure), allowed=allowed)


def _prescribed_stresses(path: Path) -> dict[str, float]:
    """Return the largest stress that each field, or each phase, of a path prescribes, name -> Pa."""
    largest = {name: float(np.max(getattr(path, name, None) or 0.0)) for name in ("pressure", "pressures", "stresses")}
    for number, phase in enumerate(path.steps if isinstance(path, Steps) else (), start=1):
        name = phase.label or f"step {number}"
        largest[name] = max(largest.get(name, 0.0), phase.largest_stress)
    return largest


def expected_inertial_number(path: Path, state: State, pressure: float) -> float:
    """Expected inertial number at the start of a path with an axial rate, at a mean stress of `pressure`, Pa.

    Strain rates that the servo adjusts are assumed to keep the volume constant.
    """
    first = next(iter(path.steps_from(Here())))
    return inertial_number_of(
        first, rate_of(path), 0.0, 2.0 * float(state.body_radius.mean()), state.scene.density, pressure
    )


def inertial_number_of(
    step: Step, rate: float, accumulated: float, diameter: float, density: float, pressure: float
) -> float:
    """Expected inertial number in a step of a path.

    Args:
        step: The step.
        rate: Strain rate by which the rates of the step are multiplied, 1/s.
        accumulated: Accumulated strain.
        diameter: Mean diameter, m.
        density: Density of the grains, kg/m3.
        pressure: Mean stress, Pa.
    """
    rates = rate * symmetric(step.rates(accumulated))
    control = step.held
    if control is not None and rates.any():
        adjusted = np.flatnonzero(control.free[:3].any(axis=1) & (np.diag(rates) == 0.0))
        rates[adjusted, adjusted] = -np.trace(rates) / max(len(adjusted), 1)
    return float(inertial_number(rates, pressure, diameter, density))


def rate_warning(path: Path, state: State, prescribed: float | None = None) -> str | None:
    """Return a warning if the strain rate of a path will make the inertial number of a specimen exceed its limit.

    The pressure is the one that the path holds, or the mean stress of the specimen. `prescribed` is the inertial number
    if it is prescribed instead of the rate.
    """
    if prescribed is not None:
        above = f"the inertial number {prescribed:g} is above the limit {INERTIAL_LIMIT:g} for quasi-static tests"
        return above if prescribed > INERTIAL_LIMIT else None
    pressure = path.start_pressure() or float(mean_stress(love_stress(state.snapshot())))
    if pressure <= 0.0:  # the grains carry no stress yet
        return None
    number = expected_inertial_number(path, state, pressure)
    if number <= INERTIAL_LIMIT:
        return None
    slower = SAFE * rate_of(path) * INERTIAL_LIMIT / number
    return (
        f"at the axial strain rate {path.rate:g} 1/s the inertial number will be about {number:.2g}, above the "
        f"limit {INERTIAL_LIMIT:g} for quasi-static tests: reduce the rate to {slower:.2g} 1/s to stay below it with "
        "a margin"
    )


def size_warning(scene: Scene) -> str | None:
    """Return a warning if the grains are so large or so small that another unit was probably meant."""
    diameter = scene.mean_diameter
    if SMALL <= diameter <= LARGE:
        return None
    meant = f"if millimetres are meant, write '{diameter:g} mm'" if diameter > LARGE else "soils have more than 1e-6 m"
    return f"the grains have a mean diameter of {diameter:g} m: {meant}"


def width_warning(state: State) -> str | None:
    """Return a warning if the cell of a specimen is so narrow that its largest grains decide the results."""
    ratio = relative_width(state.cell, state.body_radius)
    if ratio >= WIDE:
        return None
    grains = 100 * math.ceil(state.number_of_grains * (WIDE / ratio) ** 3 / 100.0)
    return (
        f"the cell is only {ratio:.1f} of its largest grains wide: below {WIDE:g} a few grains decide the results; "
        f"give about {grains:,} grains"
    )


def held_errors(path: Path, scene: Scene, record: Record) -> Iterator[tuple[str, np.ndarray]]:
    """Errors of the stresses that a path holds or prescribes: name, and the errors at each record, (time, k).

    They are relative to their targets, or to the mean stress if a target is or becomes zero, and for steps to at least
    a tenth of that at the start; NaN at records where they are not judged, as in the first 0.5 % strain.
    """
    stress = to_six(symmetric(np.asarray(record["stress"])))
    pressure = mean_stress(np.asarray(record["stress"]))
    for held in path.held():
        if held.measure is None or held.target is None or held.kind != "stress":
            continue
        known = np.asarray(record.get("accumulated_strain", ()))
        travelled = known if len(known) else rate_of(on_grains(path, scene)) * np.asarray(record["time"])
        target, found = held.target, stress @ np.transpose(held.measure)
        values = np.array([target(t) if callable(target) else target for t in travelled]).reshape(found.shape)
        constant = not callable(target) and np.all(values != 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = (found - values) / (values if constant else pressure[:, None])
        error[travelled <= HELD_AFTER] = np.nan
        yield f"held: {held.name}", error
    followed = stress_errors(path, record) if len(pressure) else {}
    for name, error in followed.items():
        yield f"prescribed: {name}", (error / np.maximum(pressure, 0.1 * pressure[0]))[:, None]


def exceeded_limits(run: Record, scene: Scene, path: Path | None = None) -> tuple[Exceeded, ...]:
    """Return the limits that a run exceeds; `run` holds the variables RECORDED, and `path` what it should hold."""
    limits = []
    checked = [
        ("inertial number", run["inertial_number"], INERTIAL_LIMIT, ""),
        ("mean overlap", run["overlap_ratio"], OVERLAP_LIMIT, "%"),
        ("mean stress", mean_stress(np.asarray(run["stress"])), pressure_limit(scene), "MPa"),
    ]
    for name, error in held_errors(path, scene, run) if path is not None else ():
        worst = np.nanmax(np.abs(error), axis=1, initial=0.0)
        checked.append((f"relative error of the {name.replace(': ', ' ')}", worst, HELD_WORST, "%"))
    for name, values, limit, unit in checked:
        values = np.asarray(values)
        beyond = np.flatnonzero(values > limit)
        if len(beyond):
            strain = np.asarray(run["axial_strain"])[beyond]
            ends = float(strain.min()), float(strain.max())
            limits.append(Exceeded(name, limit, float(values[beyond].max()), len(beyond), len(values), ends, unit))
    return tuple(limits)


def exceeded_in(file: str | os.PathLike[str]) -> tuple[Exceeded, ...]:
    """Return the limits that the run in a file exceeds. Raises InputError if it is not a run file."""
    with open_netcdf(file, "run") as dataset:
        known = {name: dataset[name][...].filled(np.nan) for name in RECORDED if name in dataset.variables}
        known |= {name: np.zeros(0) for name in ALWAYS if name not in known}
        path = path_of(dataset.getncattr("path"), json.loads(dataset.path_parameters))
        return exceeded_limits(known, Scene.from_json(dataset.scene), path)


def exceeded_by(state: State) -> tuple[Exceeded, ...]:
    """Return the limits that a specimen exceeds before any test."""
    snapshot = state.snapshot()
    return tuple(
        Exceeded(name, limit, float(value), shown_in=unit)
        for name, value, limit, unit in (
            ("mean overlap", overlap_ratio(snapshot), OVERLAP_LIMIT, "%"),
            ("mean stress", mean_stress(love_stress(snapshot)), pressure_limit(state.scene), "MPa"),
        )
        if value > limit
    )


def require_shallow(snapshot: Snapshot) -> None:
    """Raise InputError if the grains overlap as deeply as after random insertion, before any relaxation."""
    overlap = overlap_ratio(snapshot)
    if overlap > OVERLAP_END:
        raise InputError(
            f"the grains overlap by {overlap:.0%} of their diameter on average, too deep for the contact law: relax "
            f"them to below {OVERLAP_END:.0%} first, as labkit specimen does"
        )
