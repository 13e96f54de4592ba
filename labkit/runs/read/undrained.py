"""Number of cycles, and liquefaction of an undrained test, from the records of a run.

An undrained test keeps the volume of the cell constant and has no pore water: its stress is the effective stress.
The excess pore pressure is u = sigma_total - sigma', where one component of the total stress is assumed constant.
r_u = u/sigma'_0 reaches 1 when this component of the effective stress vanishes. Initial liquefaction is reached when
r_u first exceeds 0.95, or when the double amplitude of the strain reaches 5 %.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from labkit.errors import InputError
from labkit.micro.stress import mean_stress
from labkit.paths.path import Path
from labkit.paths.step import Here, Step, StrainReached, StressReached

RATIO = 0.95  # r_u of initial liquefaction
DOUBLE_AMPLITUDE = 0.05  # double amplitude of the strain at initial liquefaction
SAME_VOLUME = 1e-6  # a test counts as undrained up to this relative volume change

# Constant component of the total stress -> function that returns this component of a stress (..., 3, 3).
TOTAL: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "mean": mean_stress,
    "axial": lambda stress: stress[..., 2, 2],
    "radial": lambda stress: 0.5 * (stress[..., 0, 0] + stress[..., 1, 1]),
}


@dataclasses.dataclass(frozen=True)
class Liquefaction:
    """Liquefaction of an undrained cyclic test: cycles until each criterion was first met; NaN if it was not.

    Args:
        cycles: Number of cycles of the whole test.
        largest_ratio: Largest r_u.
        cycles_to_ratio: Number of cycles to r_u > 0.95.
        largest_double_amplitude: Largest double amplitude of the strain of the path.
        cycles_to_double_amplitude: Number of cycles to a double amplitude of 5 %.
    """

    cycles: float
    largest_ratio: float
    cycles_to_ratio: float
    largest_double_amplitude: float
    cycles_to_double_amplitude: float


def pore_pressure(stress: np.ndarray, total: str = "mean", start: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Return u at every record, Pa, and sigma'_0, the initial effective stress.

    Raises InputError for an unknown component.

    Args:
        stress: Effective stress, (n, 3, 3), Pa.
        total: Component of the total stress that is constant: "mean", "axial" or "radial".
        start: Effective stress at the start of undrained loading, (3, 3), Pa (default: at the first record).
    """
    if total not in TOTAL:
        raise InputError("is unknown", field="total", value=total, allowed=f"one of {', '.join(TOTAL)}", quoted=True)
    effective = TOTAL[total](stress)
    initial = float(effective[0] if start is None else TOTAL[total](start))
    return initial - effective, initial


def number_of_cycles(path: Path | None, strain: np.ndarray, stress: np.ndarray, reversals: np.ndarray) -> np.ndarray:
    """Return the number of cycles completed at every record, (n,): each step is half a cycle.

    Within a step the number grows with the controlled strain or stress, from the value of this quantity at the last
    reversal to the target of the step; where the quantity turns back, the number remains constant.

    Args:
        path: The path; if it is None because the path is not registered, the number grows only at reversals.
        strain: (n, 3, 3).
        stress: (n, 3, 3), Pa.
        reversals: Indices of the records at which the path reversed.
    """
    cycles = np.zeros(len(strain))
    parts = itertools.pairwise([0, *reversals.tolist(), len(strain) - 1])
    steps = iter(()) if path is None else iter(path.steps_from(Here()))
    for number, (first, last) in enumerate(parts):
        part, step = slice(first, last + 1), next(steps, None)
        done = np.zeros(last + 1 - first)
        if path is not None and step is not None:
            values, target = _controlled_quantity(path, step, strain[part], stress[part])
            length = target - values[0]
            done = np.clip(np.maximum.accumulate((values - values[0]) / length), 0.0, 1.0) if length else done
        cycles[part] = 0.5 * (number + done)
    return cycles


def _controlled_quantity(path: Path, step: Step, strain: np.ndarray, stress: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the strain or stress that ends a step, at every record (n,), and the value at which the step ends."""
    for end in step.until.each:
        if isinstance(end, StressReached):
            return np.array([end.measured(one) for one in stress]), end.level
        if isinstance(end, StrainReached) and end.turn is not None:
            return path.strain_measure().at(strain), end.turn
    return np.zeros(len(strain)), 0.0


def double_amplitude(strain: np.ndarray, reversals: np.ndarray) -> np.ndarray:
    """Return the change of a scalar strain (n,) since the last reversal, or since the start, at every record."""
    last = np.zeros(len(strain), dtype=int)
    last[reversals] = reversals
    before = np.concatenate([[0], np.maximum.accumulate(last)[:-1]])  # a reversal ends the previous step
    return np.abs(strain - strain[before])


def liquefaction(cycles: np.ndarray, ratio: np.ndarray, amplitude: np.ndarray) -> Liquefaction:
    """Return the Liquefaction from the number of cycles, r_u and the double amplitude at every record, (n,)."""
    return Liquefaction(
        cycles=float(cycles[-1]),
        largest_ratio=float(ratio.max()),
        cycles_to_ratio=_first(cycles, ratio > RATIO),
        largest_double_amplitude=float(amplitude.max()),
        cycles_to_double_amplitude=_first(cycles, amplitude >= DOUBLE_AMPLITUDE),
    )


def _first(cycles: np.ndarray, met: np.ndarray) -> float:
    return float(cycles[np.argmax(met)]) if met.any() else float("nan")
