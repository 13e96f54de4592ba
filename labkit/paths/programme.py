"""The programme of a step of mixed control: rates and target stresses as functions of the accumulated strain."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from labkit.files.schema import Variable
from labkit.micro.stress import mean_stress
from labkit.micro.tensors import symmetric, to_six
from labkit.paths.mixed_step import MixedStep
from labkit.paths.step import Here, RecordMeets, Step, StrainReached

LOST = 0.05  # fraction of the mean stress: a held stress with a larger deviation does not follow its target

PROGRESS = {
    "path_step": Variable("path_step", ("time",), "f8", "1", "number of the step of the path, from 1"),
    "path_step_progress": Variable("path_step_progress", ("time",), "f8", "1", "completed share of this step"),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Programme:
    """A step of mixed control together with the stress at which it starts.

    Args:
        mixed: The increments.
        number: Number of the step, from 0.
        length: Accumulated strain of the step.
        start: Stress at the start, six components in Mandel notation, Pa.
        knots: Accumulated strains at which `completed` rows are done, (m + 1,).
        completed: Numbers of rows completed at the knots, (m + 1,).
        least_pressure: Deviation from a target that is always accepted, Pa.
    """

    mixed: MixedStep
    number: int
    length: float
    start: np.ndarray
    knots: np.ndarray
    completed: np.ndarray
    least_pressure: float

    @property
    def rests(self) -> bool:
        """True if neither strains nor stresses change, so that a material without viscosity does not change."""
        return not any(self.mixed.strain) and not any(self.mixed.stress) and not self.mixed.absolute

    @property
    def varies(self) -> bool:
        """True if the prescribed rates or the held stresses may change with the accumulated strain."""
        return bool(self.mixed.measured) or self.mixed.rows > 1

    @property
    def label(self) -> str:
        """Name of the step at the start of a message, with a colon."""
        return f"{self.mixed.label or f'step {self.number + 1}'}: "

    @functools.cached_property
    def _flows(self) -> np.ndarray:
        """Prescribed velocity gradients between the knots, divided by the rate, (m, 3, 3)."""
        total = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(self.mixed.strains, axis=0)])[self.completed]
        return np.diff(total, axis=0) / np.diff(self.knots)[:, None, None]

    def _row(self, accumulated: float) -> int:
        """Return the index of the interval between knots that contains an accumulated strain."""
        return int(np.clip(np.searchsorted(self.knots, accumulated, side="right") - 1, 0, len(self.knots) - 2))

    def share(self, accumulated: float) -> float:
        """Return the completed fraction of the step."""
        return float(np.interp(accumulated, self.knots, self.completed)) / self.mixed.rows

    def rates(self, accumulated: float) -> np.ndarray:
        """Return the prescribed velocity gradient divided by the rate, (3, 3)."""
        return self._flows[self._row(accumulated)]

    def target(self, accumulated: float) -> np.ndarray:
        """Return the targets of the held stresses, (k,), Pa."""
        return self.mixed.target_at(self.share(accumulated), self.mixed.measure @ self.start)

    def next_change(self, accumulated: float) -> float:
        """Return the accumulated strain at which the prescribed rates next change abruptly."""
        return float(self.knots[self._row(accumulated) + 1])

    def interval(self, record_strain: float | None, standard: float) -> float:
        """Return the accumulated strain between two records; `record_strain` is the user's choice, if any."""
        records = self.mixed.records if record_strain is None else None
        return self.length / records if records is not None else min(record_strain or standard, self.length)

    def progress(self, accumulated: float) -> Mapping[str, float]:
        """Return the values of the variables PROGRESS."""
        return {"path_step": self.number + 1.0, "path_step_progress": self.share(accumulated)}

    def why_lost(self, stress: np.ndarray, accumulated: float) -> str:
        """Say why a held stress no longer follows its target; empty if all held stresses do. `stress` is (3, 3), Pa."""
        if not self.mixed.measured:
            return ""
        target = self.target(accumulated)
        reached = self.mixed.measure @ to_six(symmetric(stress))
        k = int(np.abs(reached - target).argmax())
        if abs(reached[k] - target[k]) <= max(LOST * float(mean_stress(stress)), self.least_pressure):
            return ""
        return (
            f"{self.label}{self.mixed.names[k]} is {reached[k]:.4g} Pa and cannot follow its target, {target[k]:.4g} "
            "Pa: the target exceeds the strength of the specimen, or changes too fast; prescribe a strain or a smaller "
            "stress, or reduce the rate"
        )


def controlled_step(
    mixed: MixedStep, number: int, length: float, difference: float, pressure: float, least_pressure: float, here: Here
) -> Step:
    """Return the step that carries out a step of mixed control from the stress `here`.

    Args:
        mixed: The increments.
        number: Number of the step, from 0.
        length: Accumulated strain of the step.
        difference: The same length, computed as a difference of accumulated strains, which rounds differently.
        pressure: Mean stress expected at the start, Pa.
        least_pressure: Deviation from a target that is always accepted, Pa.
        here: The stress at the start, and the accumulated strain of a time step.
    """
    knots = np.concatenate([[0.0], np.cumsum(mixed.lengths(pressure))])
    if here.step_strain:  # round to a whole number of time steps
        knots = here.step_strain * np.round(knots / knots[-1] * int(np.round(difference / here.step_strain)))
    knots, rows = np.unique(knots, return_index=True)  # join a row shorter than a time step with the next row
    rows[-1] = mixed.rows
    start = to_six(symmetric(here.stress))
    programme = Programme(mixed, number, length, start, knots, rows, least_pressure)
    control = mixed.control(programme.target) if mixed.measured else None
    end = StrainReached(difference)
    until = end if mixed.until is None else end | RecordMeets(mixed.until)
    return Step(programme.rates, control, until, 8.0, programme)
