"""The limits in section 2 of the paper, within which a test is quasi-static and contact overlaps are small."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterator

import numpy as np

from labkit.errors import InputError
from labkit.files.netcdf import open_netcdf
from labkit.grains.scene import Scene
from labkit.grains.state import State
from labkit.micro.cells import relative_width
from labkit.micro.indicators import inertial_number, overlap_ratio
from labkit.micro.snapshot import Snapshot, love_stress
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.parameters import parameters_of
from labkit.paths.path import Held, Path
from labkit.paths.programme import PROGRESS
from labkit.paths.rates import on_grains, rate_of
from labkit.paths.registry import path_of
from labkit.paths.step import Here, Step
from labkit.paths.steps import Steps, stress_errors
from labkit.paths.strain_measures import AXIAL
from labkit.quantities.scalars import Record

STRESS_LIMIT = 0.02  # mean stress divided by E (3 MPa for Table 1) at which the mean overlap reaches its limit
OVERLAP_LIMIT = 0.02  # mean delta/D
OVERLAP_END = 0.1  # mean delta/D of an unrelaxed specimen: 0.2 after random insertion, 0.053 at rest with e = 0.3
INERTIAL_LIMIT = 3e-4
LEAST, MOST = 0.1, 10.0  # limits of the pace; without them a specimen that loses its stress would come to a halt
OFF = 2.0  # factor by which the median inertial number may differ from the prescribed one
SAFE = 0.7  # suggested rate over expected limit: dilating specimens had up to 20 % larger inertial numbers
GRAINS_LIMIT = (13_800, 15_000)  # grains in a cube of 4 mm
SMALL, LARGE = 1e-6, 0.1  # range of plausible grain sizes (m)
WIDE = 10.0  # smallest width of a cell divided by the diameter of its largest grain
DRIFT_LIMIT = 0.01  # fraction of the kinetic energy due to the motion of the centre of mass

HELD_RMS, HELD_WORST = 0.005, 0.02  # relative errors of the stress that a path holds
HELD_AFTER = 0.005  # accumulated axial strain from which a held stress is checked

PRESCRIBED = "prescribed_inertial_number"  # an option of the run, not a variable
ALWAYS = ("axial_strain", "inertial_number", "overlap_ratio", "stress")  # variables that exceeded_limits() always needs
RECORDED = (
    *ALWAYS,
    "strain",
    "void_ratio",
    "time",
    "accumulated_strain",
    *PROGRESS,
)  # these and the variables needed to check held stresses
SHOWN_IN = {"": 1.0, "%": 100.0, "MPa": 1e-6}  # unit in a message -> factor that converts a fraction or Pa to it


@dataclasses.dataclass(frozen=True)
class Exceeded:
    """A limit that a run or a specimen exceeds.

    A run exceeds the limit at `records` of its `of` records. `strain` contains the smallest and the largest strain at
    these records; `measure` names this strain, the one that the path drives. `largest` is the largest value. For a
    specimen `records`, `of` and `strain` are zero. The message shows the limit and the largest value in the unit
    `shown_in`, a key of SHOWN_IN.
    """

    name: str
    limit: float
    largest: float
    records: int = 0
    of: int = 0
    strain: tuple[float, float] = (0.0, 0.0)
    shown_in: str = ""
    measure: str = "axial strain"

    def __str__(self) -> str:
        factor, unit = SHOWN_IN[self.shown_in], f" {self.shown_in}".rstrip()
        limit, largest = f"{factor * self.limit:g}{unit}", f"{factor * self.largest:.3g}{unit}"
        if not self.of:
            return f"a {self.name} of {largest} is above the limit of {limit}"
        strains = self.measure.replace("strain", "strains", 1)
        if np.isinf(self.largest):
            largest = "infinite: the specimen collapsed or was pulled apart, and carries no stress there (p = 0)"
        return (
            f"the {self.name} is above the limit of {limit} at {self.records} of {self.of} records, at {strains} from "
            f"{self.strain[0]:.2%} to {self.strain[1]:.2%}; its largest value is {largest}"
        )


def pressure_limit(scene: Scene) -> float:
    """Return the mean stress (Pa) up to which overlaps stay small: 0.02 E."""
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
        if name not in parameters_of(type(path)):  # `name` is a step of the path
            raise InputError(f"{name}: {pressure:g} {problem}: give {allowed}")
        raise InputError(problem, field=name, value=float(pressure), allowed=allowed)


def _prescribed_stresses(path: Path) -> dict[str, float]:
    """Return the largest stress (Pa) that each field, or each step, of a path prescribes, by name."""
    largest = {name: float(np.max(getattr(path, name, None) or 0.0)) for name in ("pressure", "pressures", "stresses")}
    for number, step in enumerate(path.steps if isinstance(path, Steps) else (), start=1):
        name = step.label or f"step {number}"
        largest[name] = max(largest.get(name, 0.0), step.largest_stress)
    return largest


def expected_inertial_number(path: Path, scene: Scene, pressure: float, diameter: float | None = None) -> float:
    """Return the expected inertial number at the start of a path.

    Strain rates that the servo adjusts are assumed to keep the volume constant.

    Args:
        path: The path, with a rate.
        scene: The scene.
        pressure: Mean stress (Pa).
        diameter: Mean grain diameter, m (default: that of the scene).
    """
    first = next(iter(path.steps_from(Here())))
    return inertial_number_of(first, rate_of(path), 0.0, diameter or scene.mean_diameter, scene.density, pressure)


def inertial_number_of(
    step: Step, rate: float, accumulated: float, diameter: float, density: float, pressure: float
) -> float:
    """Return the expected inertial number in a step of a path.

    Args:
        step: The step.
        rate: Strain rate (1/s) by which the rates of the step are multiplied.
        accumulated: Accumulated strain.
        diameter: Mean grain diameter (m).
        density: Density of the grains (kg/m3).
        pressure: Mean stress (Pa).
    """
    rates = rate * symmetric(step.rates(accumulated))
    control = step.held
    if control is not None and rates.any():
        adjusted = np.flatnonzero(control.free[:3].any(axis=1) & (np.diag(rates) == 0.0))
        rates[adjusted, adjusted] = -np.trace(rates) / max(len(adjusted), 1)
    return float(inertial_number(rates, pressure, diameter, density))


def rate_warning(path: Path, state: State, prescribed: float | None = None) -> str | None:
    """Return a warning if a path's strain rate would bring the inertial number of a specimen above the limit.

    The inertial number is computed at the pressure that the path holds or else at the mean stress of the specimen.
    `prescribed` is the inertial number if the path prescribes it instead of the rate.
    """
    pressure = path.start_pressure() or float(mean_stress(love_stress(state.snapshot())))
    number = 0.0  # if the grains carry no stress yet
    if pressure > 0.0:
        number = expected_inertial_number(path, state.scene, pressure, 2.0 * float(state.body_radius.mean()))
    if prescribed is not None:
        return _prescribed_warning(prescribed, number)
    if number <= INERTIAL_LIMIT:
        return None
    slower = slower_rate(path, number)
    return (
        f"at the axial strain rate {path.rate:g} 1/s the inertial number will be about {number:.2g}, above the "
        f"limit {INERTIAL_LIMIT:g} for quasi-static tests: reduce the rate to {slower:.2g} 1/s to stay below it with "
        "a margin"
    )


def _prescribed_warning(prescribed: float, number: float) -> str | None:
    """Return a warning if a prescribed inertial number is too high, or not reached; `number`: at the default rate."""
    reached = min(max(prescribed, LEAST * number), MOST * number) if number > 0.0 else prescribed
    if reached != prescribed:
        return (
            f"the inertial number {prescribed:g} is not reached: the rate stays within {LEAST:g} to {MOST:g} times the "
            f"default rate, which gives about {reached:.2g}, as the run file records it: give {LEAST * number:.2g} to "
            f"{MOST * number:.2g}, or a rate instead"
        )
    above = f"the inertial number {prescribed:g} is above the limit {INERTIAL_LIMIT:g} for quasi-static tests"
    return above if prescribed > INERTIAL_LIMIT else None


def slower_rate(path: Path, number: float) -> float:
    """Return the rate (1/s) of a path with a lower inertial number than `number`, below the limit with a margin."""
    return SAFE * rate_of(path) * INERTIAL_LIMIT / number


def size_warning(scene: Scene) -> str | None:
    """Return a warning if the grains are so large or so small that the unit of their size is probably wrong."""
    diameter = scene.mean_diameter
    if SMALL <= diameter <= LARGE:
        return None
    meant = f"if millimetres are meant, write '{diameter:g} mm'" if diameter > LARGE else "soils have more than 1e-6 m"
    return f"the grains have a mean diameter of {diameter:g} m: {meant}"


def width_warning(state: State) -> str | None:
    """Return a warning if the cell of a specimen is so narrow that its largest grains dominate the results."""
    ratio = relative_width(state.cell, state.body_radius)
    if ratio >= WIDE:
        return None
    grains = 100 * math.ceil(len(state.body_radius) * (WIDE / ratio) ** 3 / 100.0)
    kind, size = ("grains", "") if state.bodies is None else ("clumps", ", taken as spheres of equal volume")
    return (
        f"the cell is only {ratio:.1f} of its largest {kind} wide{size}: below {WIDE:g} a few {kind} decide the "
        f"results; give about {grains:,} grains"
    )


def held_errors(path: Path, scene: Scene, record: Record) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (name, errors at each record, (time, k)) for the stresses that a path holds or prescribes.

    Errors of held stresses are relative to the target, or to the mean stress if the target varies or is zero. Errors of
    prescribed stresses are relative to the mean stress, or to a tenth of its initial value if that is larger. Errors
    are NaN at records that are not checked, such as records within the first 0.5 % of strain.
    """
    stress = to_six(symmetric(np.asarray(record["stress"])))
    pressure = mean_stress(np.asarray(record["stress"]))
    for condition in path.held():
        if condition.kind == "total":
            yield f"held: {condition.name}", _total_error(condition, stress, pressure, record)
        if condition.measure is None or condition.target is None or condition.kind != "stress":
            continue
        strain = np.asarray(record.get("accumulated_strain", ()))
        accumulated_strain = strain if len(strain) else rate_of(on_grains(path, scene)) * np.asarray(record["time"])
        target, measured = condition.target, stress @ np.transpose(condition.measure)
        values = np.array([target(t) if callable(target) else target for t in accumulated_strain]).reshape(
            measured.shape
        )
        constant = not callable(target) and np.all(values != 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = (measured - values) / (values if constant else pressure[:, None])
        error[accumulated_strain <= HELD_AFTER] = np.nan
        yield f"held: {condition.name}", error
    followed = stress_errors(path, record) if len(pressure) else {}
    for name, error in followed.items():
        yield f"prescribed: {name}", (error / np.maximum(pressure, 0.1 * pressure[0]))[:, None]


def _total_error(held: Held, stress: np.ndarray, pressure: np.ndarray, record: Record) -> np.ndarray:
    """Return the change of a held total stress, relative to the mean stress at the start, (time, 1)."""
    strain, e = np.asarray(record["strain"]), np.asarray(record["void_ratio"])[0]
    u = np.trace(strain, axis1=1, axis2=2)[:, None] * held.target * (1.0 + e) / e
    total = stress @ np.transpose(held.measure) + u
    return (total - total[:1]) / pressure[0]


def prescribed_number(path_parameters: str) -> dict[str, np.ndarray]:
    """Return the inertial number that a run was to be sheared at, as a value for `exceeded_limits`; empty if none."""
    number = json.loads(path_parameters).get("inertial_number")
    return {} if number is None else {PRESCRIBED: np.array(float(number))}


def _factors_off(run: Record) -> np.ndarray:
    """Return the factors by which a run missed its prescribed inertial number, (time,); 1 if its median is near it."""
    number, wanted = np.asarray(run["inertial_number"]), run.get(PRESCRIBED)
    factors = np.ones(len(number))
    if wanted is not None and len(number) > 1:  # the first record is at rest
        ratio = np.maximum(number[1:], np.finfo(float).tiny) / wanted
        factors[1:] = np.maximum(ratio, 1.0 / ratio)
    return factors if np.median(factors[1:] if len(factors) > 1 else 1.0) > OFF else np.ones(len(number))


def exceeded_limits(run: Record, scene: Scene, path: Path | None = None) -> tuple[Exceeded, ...]:
    """Return the limits that a run exceeds.

    `run` contains the variables RECORDED and, if the run has it, PRESCRIBED; `path` defines the held stresses.
    """
    measure = path.strain_measure() if path is not None and "strain" in run else AXIAL
    strains = np.asarray(run["axial_strain"]) if measure is AXIAL else measure.at(np.asarray(run["strain"]))
    limits = []
    checked = [
        ("inertial number", run["inertial_number"], INERTIAL_LIMIT, ""),
        ("factor between the inertial number and the prescribed one", _factors_off(run), OFF, ""),
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
            ends, largest = (float(strains[beyond].min()), float(strains[beyond].max())), float(values[beyond].max())
            limits.append(Exceeded(name, limit, largest, len(beyond), len(values), ends, unit, measure.name))
    return tuple(limits)


def exceeded_in(file: str | os.PathLike[str]) -> tuple[Exceeded, ...]:
    """Return the limits that the run in a file exceeds. Raises InputError if it is not a run file."""
    with open_netcdf(file, "run") as dataset:
        records = {name: dataset[name][...].filled(np.nan) for name in RECORDED if name in dataset.variables}
        records |= {name: np.zeros(0) for name in ALWAYS if name not in records}
        records |= prescribed_number(dataset.path_parameters)
        path = path_of(dataset.getncattr("path"), json.loads(dataset.path_parameters))
        return exceeded_limits(records, Scene.from_json(dataset.scene), path)


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
