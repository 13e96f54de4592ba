"""The progress of a test in one line."""

from __future__ import annotations

import numpy as np

from labkit.micro.stress import mean_stress
from labkit.paths.element_tests import StressRotation
from labkit.paths.path import Path
from labkit.paths.step import Here, Record, StrainReached
from labkit.paths.strain_measures import AXIAL, SHEAR


def status_of(path: Path, record: Record, number: int, steps: int) -> str:
    """Describe the progress of a test: its current step or cycle, strain and mean stress.

    Args:
        path: The path.
        record: The latest record.
        number: Number of the current step, from 0.
        steps: Number of steps of the path.
    """
    measure, stress = path.strain_measure(), record["stress"]
    p = mean_stress(stress) / 1e3
    aim = _aim(path) if steps == 1 and measure in (AXIAL, SHEAR) else ""
    text = f"{measure.name} {measure.at(record['strain']):.2%}{aim}, p {p:.{1 if p < 1e3 else 0}f} kPa"
    if isinstance(path, StressRotation):
        angle = 0.5 * np.degrees(np.arctan2(stress[0, 2] + stress[2, 0], stress[2, 2] - stress[0, 0]))
        text = f"sigma_1 at {angle:.0f} degrees to z, {text}"
    if steps == 1:
        return text
    what, number, of = ("cycle", number // 2, steps // 2) if path.cyclic else ("step", number, steps)
    return f"{what} {min(number + 1, of)} of {of}, {text}"


def _aim(path: Path) -> str:
    """Return the strain at which the only step of a path ends, after `of`; empty if it may end at a stress."""
    ends = next(iter(path.steps_from(Here()))).until.each
    turns = [end.turn for end in ends if isinstance(end, StrainReached) and end.turn is not None]
    return f" of {turns[0]:.2%}" if turns and len(ends) == 1 else ""
