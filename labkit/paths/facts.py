"""The facts of a path that quantities need (labkit.quantities.scalars), and the number of cycles."""

from __future__ import annotations

import contextlib
import functools
import itertools

import numpy as np

from labkit.errors import InputError
from labkit.paths.path import Path
from labkit.paths.step import Here, Step, StrainReached, StressReached
from labkit.paths.steps import is_symmetric
from labkit.paths.strain_measures import AXIAL, StrainMeasure
from labkit.quantities.conditions import Condition
from labkit.quantities.scalars import Facts

QUARTER = 0.25  # of a cycle, from zero to the first reversal
MOST_EXAMINED = 1000  # steps of a path that are searched for one at constant volume


def facts_of(
    path: Path | None, measure: StrainMeasure | None = None, undrained_stress: np.ndarray | None = None
) -> Facts:
    """Return the facts of a path, before any loading. None is a path that is not registered in this process.

    Args:
        path: The path.
        measure: The scalar strain, if it is not that of the path.
        undrained_stress: Stress at the start of the undrained loading that the run continues, (3, 3), Pa, if any.
    """
    if path is None:
        return Facts(amplitude=functools.partial(double_amplitude, measure or AXIAL))
    measure, undrained = measure or path.strain_measure(), False
    count = functools.partial(number_of_cycles, path, measure, undrained_stress=undrained_stress)
    with contextlib.suppress(InputError):  # the pressure to hold is unknown
        undrained = any(step.undrained for step in itertools.islice(path.steps_from(Here()), MOST_EXAMINED))
    return Facts(
        f"this run of {path.name}",
        is_symmetric(path),
        undrained,
        total=path.total or "mean",
        strain=measure.at,
        strain_name=measure.name,
        accumulate=measure.accumulate,
        amplitude=functools.partial(double_amplitude, measure),
        cycles=count if path.cyclic else None,
    )


def require_meaning(path: Path, facts: Facts, stop_when: Condition | None) -> None:
    """Raise InputError if a condition of the path, or `stop_when`, reads a quantity that has no meaning for it."""
    if stop_when is not None:
        stop_when.require_meaning(facts)
    for step in itertools.islice(path.steps_from(Here()), MOST_EXAMINED):
        for end in step.conditions:
            end.condition.require_meaning(step.facts(facts))


def number_of_cycles(
    path: Path | None,
    measure: StrainMeasure,
    strain: np.ndarray,
    stress: np.ndarray,
    undrained_stress: np.ndarray | None = None,
) -> np.ndarray:
    """Return the number of cycles N completed at every record, (n,), counted as in ASTM D5311.

    A step between two reversals is half a cycle. The first step, which begins between the two, is a quarter if it
    begins in the middle: N = 0.25 at the first peak. Within a step the number grows with the controlled strain or
    stress; where this quantity turns back, the number remains constant.

    Args:
        path: The path; if it is None because the path is not registered, the number grows only at reversals.
        measure: The scalar strain that reverses.
        strain: (n, 3, 3).
        stress: (n, 3, 3), Pa.
        undrained_stress: Stress at the start of the undrained loading that the run continues, (3, 3), Pa, if any.
    """
    start = Here(stress[0], undrained=undrained_stress)
    cycles, begun = np.zeros(len(strain)), 0.0
    parts = itertools.pairwise([0, *measure.reversals(strain).tolist(), len(strain) - 1])
    steps = iter(()) if path is None else itertools.pairwise([*path.steps_from(start), None])
    for number, (first, last) in enumerate(parts):
        part, (step, after) = slice(first, last + 1), next(steps, (None, None))
        done, share = np.zeros(last + 1 - first), 0.5 if number else QUARTER
        if step is not None:
            values, target = _controlled_quantity(measure, step, strain[part], stress[part])
            length = target - values[0]
            done = np.clip(np.maximum.accumulate((values - values[0]) / length), 0.0, 1.0) if length else done
            if not number and after is not None:
                whole = abs(_controlled_quantity(measure, after, strain[part], stress[part])[1] - target)
                share = 0.5 * min(1.0, abs(length) / whole) if whole else QUARTER
        cycles[part] = begun + share * done
        begun += share
    return cycles


def _controlled_quantity(
    measure: StrainMeasure, step: Step, strain: np.ndarray, stress: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the strain or stress that ends a step, at every record (n,), and the value at which the step ends."""
    for end in step.until.each:
        if isinstance(end, StressReached):
            return np.array([end.measured(each) for each in stress]), end.level
        if isinstance(end, StrainReached) and end.turn is not None:
            return measure.at(strain), end.turn
    return np.zeros(len(strain)), 0.0


def double_amplitude(measure: StrainMeasure, strain: np.ndarray) -> np.ndarray:
    """Return the change of a scalar strain since its last reversal, or since the start, at every record, (n,).

    Args:
        measure: The scalar strain.
        strain: (n, 3, 3).
    """
    scalar, reversals = measure.at(strain), measure.reversals(strain)
    last = np.zeros(len(strain), dtype=int)
    last[reversals] = reversals
    before = np.concatenate([[0], np.maximum.accumulate(last)[:-1]])  # a reversal ends the previous step
    return np.abs(scalar - scalar[before])
