"""Numbers of one-dimensional and isotropic compression: C_c, C_s and K0."""

from __future__ import annotations

import dataclasses

import numpy as np
import xarray

from labkit.errors import InputError
from labkit.results.dataset import datasets_of
from labkit.results.run import Run

VIRGIN = 0.5  # C_c and K0 are taken where sigma_z exceeds this fraction of its largest value
LEAST_FALL = 0.8  # a branch that ends above this fraction of the largest sigma_z is no unloading
FEWEST = 3  # records of a fit
DRIFT = 0.02  # a larger difference between K0 and its value at the end is said
SIDEWAYS = 0.02  # of the axial strain: a lateral strain below it is none


@dataclasses.dataclass(frozen=True)
class CompressionNumbers:
    """Numbers of a compression test; NaN if the test does not show them.

    Args:
        compression_index: C_c = -de/d log10 sigma_z of first loading, over its last factor of two in sigma_z.
        swelling_index: C_s = -de/d log10 sigma_z between the ends of the first unloading.
        K0: Mean of sigma_x/sigma_z (x and y averaged) of first loading without lateral strain, over its last factor of
            two.
        K0_at_end: The same ratio at its largest sigma_z: smaller than K0 while it still falls from an isotropic start.
        stress: Least and largest sigma_z of the records of C_c and K0, Pa.
    """

    compression_index: float
    swelling_index: float
    K0: float
    K0_at_end: float
    stress: tuple[float, float]

    def __str__(self) -> str:
        """Return the numbers in one line."""
        low, high = (f"{end / 1e3:.4g}" for end in self.stress)
        ends = f", {self.K0_at_end:.3f} at the end"
        numbers = {
            f"C_c = {self.compression_index:.3g}": self.compression_index,
            f"C_s = {self.swelling_index:.3g}": self.swelling_index,
            f"K0 = {self.K0:.3f}" + ends * (abs(self.K0_at_end - self.K0) > DRIFT): self.K0,
        }
        shown = ", ".join(text for text, value in numbers.items() if not np.isnan(value))
        return f"{shown} (sigma_z = {low} to {high} kPa)"


def compression_numbers(run: Run | xarray.Dataset) -> CompressionNumbers:
    """Return C_c, C_s and K0 of a run. Raises InputError if sigma_z does not double, and for a shear test.

    C_c is that of one-dimensional compression, or of isotropic compression, in which sigma_z = p.
    """
    run = datasets_of({"run": run})["run"]
    stress, e = run["stress"].values, run["void_ratio"].values
    vertical = stress[:, 2, 2]
    top = int(np.argmax(vertical))
    first = (np.arange(len(vertical)) <= top) & (vertical >= np.maximum.accumulate(vertical))
    used = first & (vertical >= VIRGIN * vertical[top])
    if used.sum() < FEWEST or not 0.0 < vertical[0] < VIRGIN * vertical[top]:
        problem = f"has no first loading in which sigma_z doubles over {FEWEST} records"
        raise InputError(problem, field="run", value=run.attrs["path"], allowed="an oedometer or isotropic compression")
    change = np.diff(run["strain"].values[np.flatnonzero(used)[[0, -1]]], axis=0)[0]
    lateral = change[[0, 1], [0, 1]] / change[2, 2]
    if lateral.min() < -SIDEWAYS:
        problem, allowed = "is a shear test: its specimen extends sideways", "an oedometer or isotropic compression"
        raise InputError(problem, field="run", value=run.attrs["path"], allowed=allowed)
    index = -np.polyfit(np.log10(vertical[used]), e[used], 1)[0]
    horizontal = stress[:, [0, 1], [0, 1]].mean(axis=1)
    ratio, at_end = float((horizontal / vertical)[used].mean()), float(horizontal[top] / vertical[top])
    if lateral.max() > SIDEWAYS:
        ratio = at_end = float("nan")
    range_of = (float(vertical[used].min()), float(vertical.max()))
    return CompressionNumbers(float(index), _swelling_index(vertical, e), ratio, at_end, range_of)


def _swelling_index(vertical: np.ndarray, e: np.ndarray) -> float:
    """Return the mean slope of the first unloading, in which e grows, to its least sigma_z; NaN without unloading."""
    largest = np.maximum.accumulate(vertical)
    at_largest = np.maximum.accumulate(np.where(vertical >= largest, np.arange(len(e)), 0))
    fallen = np.flatnonzero((vertical < LEAST_FALL * largest) & (e > e[at_largest]))  # a collapse has a smaller e
    if not len(fallen):
        return float("nan")
    start = int(at_largest[fallen[0]])
    again = np.flatnonzero(vertical[fallen[0] :] >= largest[start])
    low = start + int(np.argmin(vertical[start : fallen[0] + again[0] if len(again) else None]))
    return (
        float((e[low] - e[start]) / np.log10(vertical[start] / vertical[low])) if vertical[low] > 0.0 else float("nan")
    )
