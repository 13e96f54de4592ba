"""Undrained loading and liquefaction, from the records of a run.

The stress of an undrained test is the effective stress: the volume of the cell is constant, or changes with the
pressure of compressible pore water. The excess pore pressure is u = sigma_total - sigma', where one component of the
total stress is assumed constant.
r_u = u/sigma'_0 reaches 1 when this component of the effective stress vanishes. Initial liquefaction is reached when
r_u first exceeds 0.95, or when the double amplitude of the strain reaches 5 %.
"""

from __future__ import annotations

import dataclasses

import numpy as np

RATIO = 0.95  # r_u of initial liquefaction
DOUBLE_AMPLITUDE = 0.05  # double amplitude of the strain at initial liquefaction
SAME_VOLUME = 1e-6  # a test counts as undrained up to this relative volume change


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


def is_constant(volume: np.ndarray) -> bool:
    """Return True if a volume (n,) is constant; False for n = 0."""
    return len(volume) > 0 and bool(np.abs(volume / volume[0] - 1.0).max() < SAME_VOLUME)


def references(
    steps: np.ndarray, volume: np.ndarray, stress: np.ndarray, start: np.ndarray | None
) -> np.ndarray | None:
    """Return the stress at the start of the undrained loading to which each record belongs, (n, 3, 3), Pa.

    It is NaN at records of drained steps. Returns None if all steps are drained.

    Args:
        steps: Number of the step of the path at every record, (n,).
        volume: Volume at every record, (n,).
        stress: Effective stress at every record, (n, 3, 3), Pa.
        start: Stress at the start of undrained loading that began before the first record, (3, 3), Pa, if known.
    """
    result, reference = np.full_like(stress, np.nan), None
    ends = [*(np.flatnonzero(np.diff(steps)) + 1), len(steps)]
    first = 0
    for end in ends:
        begin = max(first - 1, 0)  # the last record of the previous step
        if end - begin > 1 and is_constant(volume[begin:end]):
            if reference is None:
                reference = start if first == 0 and start is not None else stress[begin]
                result[begin] = reference
            result[first:end] = reference
        else:
            reference = None
        first = end
    return result if np.isfinite(result).any() else None


def liquefaction(cycles: np.ndarray, ratio: np.ndarray, amplitude: np.ndarray) -> Liquefaction:
    """Return the Liquefaction from the number of cycles, r_u and the double amplitude at every record, (n,)."""
    return Liquefaction(
        cycles=float(cycles[-1]),
        largest_ratio=float(np.nanmax(ratio)),
        cycles_to_ratio=_first(cycles, ratio > RATIO),
        largest_double_amplitude=float(amplitude.max()),
        cycles_to_double_amplitude=_first(cycles, amplitude >= DOUBLE_AMPLITUDE),
    )


def _first(cycles: np.ndarray, met: np.ndarray) -> float:
    return float(cycles[np.argmax(met)]) if met.any() else float("nan")
