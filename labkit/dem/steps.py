"""A path made of steps (labkit.dem.step), each of which starts at the stress where the one before ended.

The stresses that a step controlled pass on to the next one at the values they were to have, not at those measured:
errors of the servo do not add up over many steps.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from labkit.dem.conditions import condition
from labkit.dem.control import Control
from labkit.dem.leg import Leg
from labkit.dem.loading import Path, rate_parameter
from labkit.dem.quantities import Record
from labkit.dem.step import Step
from labkit.errors import InputError
from labkit.io.schema import Variable
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six, to_tensor
from labkit.parameters import parameter, restored

TYPICAL_PRESSURE = 0.1e6  # Pa, assumed as long as the mean stress of the specimen is unknown
MOST_STEPS = 100_000
LOST = 0.05  # of the mean stress: a held stress that differs more from its target no longer follows it

PROGRESS = {
    "path_step": Variable("path_step", ("time",), "f8", "1", "number of the step of the path, from 1"),
    "path_step_progress": Variable("path_step_progress", ("time",), "f8", "1", "completed share of this step"),
}


@dataclasses.dataclass(frozen=True)
class Steps(Path):
    """Steps of mixed control, one after another: a path file, or a test for the Incremental Driver.

    A prescribed strain changes at `rate`; the default rate of a stress alone is that of a material with the stiffness
    50 p. A step whose held stresses no longer follow their targets, because no strain rate can keep them there, ends
    the run with an error.
    """

    rate: float | None = rate_parameter("largest prescribed strain rate", 10.0)
    strain: float = dataclasses.field(init=False, default=1.0)  # accumulated in all steps
    pressure: float | None = parameter(
        None, unit="Pa", above=0.0, high=1e12, help="isotropic stress to which the specimen is consolidated first"
    )
    steps: tuple[Step, ...] = parameter((), kind=Step, help="the steps as JSON; see path files")
    order: tuple[int, ...] = parameter((), help="numbers of the steps to carry out, from 0 (default: each one once)")
    mean_stress: float | None = parameter(
        None, unit="Pa", above=0.0, high=1e12, option=False, help="mean stress of the specimen at the start"
    )

    name = "steps"
    direction = (0.0, 0.0, 0.0)
    rate_limit = 8.0

    def __post_init__(self) -> None:
        """Checks the steps and their order. Raises InputError."""
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
        return restored(Steps, {**self.given(), "mean_stress": self.pressure or pressure})

    def start_pressure(self) -> float | None:
        return self.pressure

    def prescribed_stresses(self) -> dict[str, float]:
        largest = super().prescribed_stresses()
        for number, step in enumerate(self.steps, start=1):
            name = step.label or f"step {number}"
            largest[name] = max(largest.get(name, 0.0), step.largest_stress)
        return largest

    def step(self, leg: int) -> Step:
        """The step that is carried out as number `leg`, from 0."""
        return self.steps[self.order[leg]]

    @functools.cached_property
    def _pressures(self) -> tuple[float, ...]:
        """The mean stress expected at the start of each leg, Pa."""
        start = pressure = self.mean_stress or self.pressure or TYPICAL_PRESSURE
        expected = []
        for number in self.order:
            expected.append(pressure)
            pressure = max(self.steps[number].mean_after(pressure), 0.1 * start)
        return tuple(expected)

    @functools.cached_property
    def _lengths(self) -> tuple[float, ...]:
        """Accumulated strain of each leg."""
        return tuple(
            float(self.steps[number].lengths(pressure).sum())
            for number, pressure in zip(self.order, self._pressures, strict=True)
        )

    def turning_points(self) -> tuple[float, ...]:
        return tuple(np.cumsum(self._lengths).tolist()) or (self.strain,)

    def record_lengths(self, record_strain: float | None) -> tuple[float, ...]:
        interval = record_strain or self.record_strain
        lengths = []
        for number, length in zip(self.order, self._lengths, strict=True):
            records = self.steps[number].records if record_strain is None else None
            lengths.append(length / records if records is not None else min(interval, length))
        return tuple(lengths)

    def recorded(self) -> Mapping[str, Variable]:
        return PROGRESS

    def conditions(self) -> tuple[str | None, ...]:
        return tuple(self.step(number).until for number in range(self.legs()))

    def leg(
        self, number: int, sign: float, stress: np.ndarray, first: int = 0, steps: int = 0, step_strain: float = 0.0
    ) -> Leg:
        self.require_consistent()
        step = self.step(number)
        lengths = step.lengths(self._pressures[number])
        knots = np.concatenate([[0.0], np.cumsum(lengths)])
        if steps:  # whole time steps
            knots = step_strain * np.round(knots / knots[-1] * steps)
        knots, pieces = np.unique(knots, return_index=True)  # a piece shorter than a time step joins the next one
        pieces[-1] = step.pieces
        return StepLeg(
            self,
            1.0,
            first,
            number=number,
            step=step,
            start=to_six(symmetric(stress)),
            knots=knots,
            completed=pieces,
            least_pressure=LOST * (self.mean_stress or TYPICAL_PRESSURE),
        )

    @property
    def uses_servo(self) -> bool:
        return any(step.measured for step in self.steps)

    def require_consistent(self) -> None:
        """Raise InputError if there are no steps. Each step was checked when it was made."""
        if not self.steps:
            raise InputError("is empty", field="steps", allowed="at least one step, best in a path file")

    def stress_errors(self, record: Record) -> Mapping[str, np.ndarray]:
        """Held stresses minus their targets at each record of a run, name -> (time,), Pa; NaN where not held.

        record: `stress` and the variables PROGRESS along time.
        """
        stress = to_six(symmetric(np.asarray(record["stress"])))
        number, progress = (np.asarray(record[name]) for name in PROGRESS)
        errors: dict[str, np.ndarray] = {}
        start = stress[0]
        for leg in range(self.legs()):
            at = np.flatnonzero(number == leg + 1)
            at = at[progress[at] > 0.0]
            step = self.step(leg)
            if not len(at) or not step.measured:
                start = stress[at[-1]] if len(at) else start
                continue
            targets = step.target_at(progress[at], step.measure @ start)
            found = stress[at] @ step.measure.T - targets
            for name, values in zip(step.names, found.T, strict=True):
                errors.setdefault(name, np.full(len(stress), np.nan))[at] = values
            start = _corrected(stress[at[-1]], step.measure, -found[-1])
        return errors


@dataclasses.dataclass(frozen=True, eq=False)
class StepLeg(Leg):
    """One step of a path, from the stress at its start.

    start: Mandel components, Pa; knots: accumulated strain since the start of the step at which `completed` pieces are
    done, both (m + 1,); least_pressure: deviation from a target that is always accepted, Pa.
    """

    _: dataclasses.KW_ONLY
    number: int
    step: Step
    start: np.ndarray
    knots: np.ndarray
    completed: np.ndarray
    least_pressure: float

    restarts = True

    @property
    def rests(self) -> bool:
        return not any(self.step.strain) and not any(self.step.stress) and not self.step.absolute

    @property
    def label(self) -> str:
        return f"{self.step.label or f'step {self.number + 1}'}: "

    @functools.cached_property
    def _flows(self) -> np.ndarray:
        """Prescribed velocity gradients between the knots, divided by the rate, (m, 3, 3)."""
        total = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(self.step.strains, axis=0)])[self.completed]
        return np.diff(total, axis=0) / np.diff(self.knots)[:, None, None]

    def _piece(self, travelled: float) -> int:
        """Number of the interval between knots."""
        return int(np.clip(np.searchsorted(self.knots, travelled, side="right") - 1, 0, len(self.knots) - 2))

    def _completed(self, travelled: float) -> float:
        """Completed share of the step."""
        return float(np.interp(travelled, self.knots, self.completed)) / self.step.pieces

    def flow(self, travelled: float) -> np.ndarray:
        return self._flows[self._piece(travelled)]

    def control(self) -> Control | None:
        return self.step.control(self.target) if self.step.measured else None

    @property
    def varies(self) -> bool:
        return bool(self.step.measured) or self.step.pieces > 1

    def target(self, travelled: float) -> np.ndarray:
        """The targets of the held stresses (k,), Pa, at the accumulated strain `travelled` of the step."""
        return self.step.target_at(self._completed(travelled), self.step.measure @ self.start)

    def next_change(self, travelled: float) -> float:
        return float(self.knots[self._piece(travelled) + 1])

    def settled(self, stress: np.ndarray, travelled: float) -> np.ndarray:
        """The stress (3, 3), Pa, with the held stresses at their targets: where the next step starts."""
        if not self.step.measured:
            return stress
        six = to_six(symmetric(stress))
        return to_tensor(_corrected(six, self.step.measure, self.target(travelled) - self.step.measure @ six))

    def stops(self, record: Record, first: Record) -> bool:
        return self.step.until is not None and condition(self.step.until, "until").holds(record, first)

    def progress(self, travelled: float) -> Mapping[str, float]:
        return {"path_step": self.number + 1.0, "path_step_progress": self._completed(travelled)}

    def lost(self, stress: np.ndarray, travelled: float) -> str:
        if not self.step.measured:
            return ""
        target = self.target(travelled)
        found = self.step.measure @ to_six(symmetric(stress))
        k = int(np.abs(found - target).argmax())
        if abs(found[k] - target[k]) <= max(LOST * float(mean_stress(stress)), self.least_pressure):
            return ""
        return (
            f"{self.label}{self.step.names[k]} is {found[k]:.4g} Pa and cannot follow its target, {target[k]:.4g} Pa: "
            "the target exceeds the strength of the specimen, or changes too fast; prescribe a strain or a smaller "
            "stress, or reduce the rate"
        )


def _corrected(six: np.ndarray, measure: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """The stress nearest to `six` (6,) whose combinations `measure` (k, 6) are larger by `missing` (k,)."""
    return six + np.linalg.lstsq(measure, missing, rcond=None)[0]
