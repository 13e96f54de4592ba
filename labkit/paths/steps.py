"""A path made of steps (labkit.paths.step), each of which starts at the stress where the previous one ended.

A step passes the targets of its held stresses on to the next step, not the measured values, so that errors of the servo
do not add up over many steps.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Iterable, Mapping

import numpy as np

from labkit.errors import InputError
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.parameters import Number, parameter, without_option
from labkit.paths.mixed_step import MixedStep, is_about_z
from labkit.paths.path import Path, rate_parameter
from labkit.paths.programme import LOST, PROGRESS, controlled_step
from labkit.paths.step import Here, Step, correct_stress
from labkit.quantities.scalars import Record

TYPICAL_PRESSURE = 0.1e6  # Pa, assumed while the mean stress of the specimen is unknown
MOST_STEPS = 100_000


@dataclasses.dataclass(frozen=True)
class Steps(Path):
    """Steps of mixed control, one after another: a path file, or a test for the Incremental Driver.

    A prescribed strain changes at `rate`. The default length of a step that prescribes only stresses assumes a material
    of the stiffness 50 p. The run ends with an error if held stresses no longer follow their targets because no strain
    rate can keep them there.
    """

    rate: Number[float | None] = rate_parameter("largest prescribed strain rate", 10.0)
    strain: float = dataclasses.field(init=False, default=1.0)  # strain accumulated in all steps
    pressure: Number[float | None] = parameter(
        None, unit="Pa", above=0.0, high=1e12, help="isotropic stress to which the specimen is consolidated first"
    )
    steps: tuple[MixedStep, ...] = parameter((), kind=MixedStep, help="the steps as JSON; see path files")
    order: tuple[int, ...] = parameter((), help="numbers of the steps to carry out, from 0 (default: each one once)")
    mean_stress: Number[float | None] = without_option(
        parameter(None, unit="Pa", above=0.0, high=1e12, help="mean stress of the specimen at the start")
    )

    name = "steps"
    has_programmes = True
    direction = (0.0, 0.0, 0.0)
    rate_limit = 8.0

    def __post_init__(self) -> None:
        """Check the steps and their order. Raises InputError."""
        super().__post_init__()
        order = self.order or tuple(range(len(self.steps)))
        if any(number != int(number) or not 0 <= number < len(self.steps) for number in order):
            raise InputError(field="order", allowed=f"whole numbers from 0 to {len(self.steps) - 1}")
        if len(order) > MOST_STEPS:
            raise InputError(f"has {len(order)} steps", field="order", allowed=f"at most {MOST_STEPS}")
        object.__setattr__(self, "order", tuple(int(number) for number in order))
        if order:
            object.__setattr__(self, "strain", float(sum(self._lengths)))

    def starting_at(self, pressure: float) -> Path:
        if self.mean_stress is not None or pressure <= 0.0:
            return self
        return dataclasses.replace(self, mean_stress=self.pressure or pressure)

    def start_pressure(self) -> float | None:
        return self.pressure

    @functools.cached_property
    def _pressures(self) -> tuple[float, ...]:
        """The mean stress expected at the start of each step, Pa."""
        start = pressure = self.mean_stress or self.pressure or TYPICAL_PRESSURE
        expected = []
        for number in self.order:
            expected.append(pressure)
            pressure = max(self.steps[number].mean_after(pressure), 0.1 * start)
        return tuple(expected)

    @functools.cached_property
    def _lengths(self) -> tuple[float, ...]:
        """The accumulated strain of each step."""
        return tuple(
            float(self.steps[number].lengths(pressure).sum())
            for number, pressure in zip(self.order, self._pressures, strict=True)
        )

    def steps_from(self, start: Here) -> Iterable[Step]:
        """Yield the steps. Raises InputError if the path has none."""
        if not self.steps:
            raise InputError("is empty", field="steps", allowed="at least one step, best in a path file")
        differences = np.diff((0.0, *np.cumsum(self._lengths).tolist())).tolist()
        least = LOST * (self.mean_stress or TYPICAL_PRESSURE)
        each = zip(self.order, self._lengths, differences, self._pressures, strict=True)
        for number, (which, length, difference, pressure) in enumerate(each):
            yield controlled_step(self.steps[which], number, length, difference, pressure, least, start)


def is_symmetric(path: Path) -> bool:
    """Return True if x and y are equivalent on a path, so that q is sigma_z - (sigma_x + sigma_y)/2.

    A path declares with `axisymmetric = False` that they are not. Of a path of steps, each step is examined.
    """
    if isinstance(path, Steps):
        return all(step.axisymmetric for step in path.steps)
    with contextlib.suppress(InputError):  # `control` raises while the pressure to hold is unknown
        control = path.control()
        if not (control is None or control.axisymmetric):
            return False
    return path.axisymmetric and is_about_z(path.flow(0.0))


def stress_errors(path: Path, record: Record) -> Mapping[str, np.ndarray]:
    """Return held stresses of steps minus their targets, name -> (time,), Pa; NaN at records where they are not held.

    The result is empty for a path without programmes.

    Args:
        path: The path.
        record: `stress` and the variables PROGRESS at all records.
    """
    if not path.has_programmes:
        return {}
    stress = to_six(symmetric(np.asarray(record["stress"])))
    number, progress = (np.asarray(record[name]) for name in PROGRESS)
    errors: dict[str, np.ndarray] = {}
    here = Here(to_tensor(stress[0]))
    for before, step in enumerate(path.steps_from(here)):
        at = np.flatnonzero(number == before + 1)
        at = at[progress[at] > 0.0]
        if not len(at):
            continue
        last = stress[at[-1]]
        if step.held is not None and step.programme is not None:
            mixed = step.programme.mixed
            differences = stress[at] @ mixed.measure.T - mixed.target_at(
                progress[at], mixed.measure @ to_six(here.stress)
            )
            for name, values in zip(mixed.names, differences.T, strict=True):
                errors.setdefault(name, np.full(len(stress), np.nan))[at] = values
            last = correct_stress(last, mixed.measure, -differences[-1])
        here.stress = to_tensor(last)
    return errors
