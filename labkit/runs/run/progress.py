"""The progress of a test in one line."""

from __future__ import annotations

import numpy as np

from labkit.micro.stress import mean_stress
from labkit.paths.element_tests import StressRotation
from labkit.paths.path import Path
from labkit.paths.step import Record


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
    text = f"{measure.name} {measure.at(record['strain']):.2%}, p {p:.{1 if p < 1e3 else 0}f} kPa"
    if isinstance(path, StressRotation):
        angle = 0.5 * np.degrees(np.arctan2(stress[0, 2] + stress[2, 0], stress[2, 2] - stress[0, 0]))
        text = f"sigma_1 at {angle:.0f} degrees to z, {text}"
    if steps == 1:
        return text
    what, number, of = ("cycle", number // 2, steps // 2) if path.cyclic else ("step", number, steps)
    return f"{what} {min(number + 1, of)} of {of}, {text}"
