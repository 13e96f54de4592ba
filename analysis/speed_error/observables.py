"""The observables of a shear test that a study compares."""

from __future__ import annotations

import numpy as np
import xarray as xr

from analysis.places import texts
from labkit.results import SFF_PRESSURE, WINDOW

# name -> (label, unit, True if its error is relative); critical: mean over the last quarter of the strain
OBSERVABLES: dict[str, tuple[str, str, bool]] = texts(__file__)["observables"]
# name -> (label, unit) of quantities that show whether a test is valid
CHECKS: dict[str, tuple[str, str]] = texts(__file__)["checks"]
AROUND = 0.0025  # a value at a strain is the mean over this axial strain on each side
PEAK = 0.01  # axial strain over which the peak is averaged


def observables(run: xr.Dataset, held: float | None) -> dict[str, float]:
    """Values of OBSERVABLES and CHECKS of a complete shear test, by name.

    `held`: the mean stress that the path holds (Pa), or None.
    """
    strain, end = run["axial_strain"].values, critical(run["axial_strain"].values)
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    sff = run.lab.sff_error().values[p > SFF_PRESSURE]

    def mean(name: str) -> float:
        return float(np.mean(run[name].values[end]))

    def zz(name: str) -> float:
        return float(np.mean(run[name].values[end, 2, 2]))

    return {
        **strength(strain, p, q),
        "void_ratio_critical": mean("void_ratio"),
        "Z_critical": mean("coordination_number"),
        "Lambda_critical": mean("mean_normalised_force"),
        "A_critical": zz("contact_anisotropy"),
        "F_critical": zz("normal_force_anisotropy"),
        "Ft_critical": zz("mobilisation"),
        "sff_error": float(sff.mean()) if sff.size else np.nan,
        "energy_balance_error": float(np.abs(run["energy_balance_error"].values).max()),
        "held_error": float(np.sqrt(np.mean((p[strain > 2 * AROUND] / held - 1.0) ** 2))) if held else np.nan,
        "inertial_number": float(np.median(run["inertial_number"].values[1:])),
        "overlap_ratio": float(run["overlap_ratio"].values.mean()),
    }


def critical(strain: np.ndarray) -> np.ndarray:
    """Mask (record,) of the critical state: the last quarter of the strain."""
    return strain >= (1.0 - WINDOW) * strain[-1]


def strength(strain: np.ndarray, p: np.ndarray, q: np.ndarray) -> dict[str, float]:
    """The observables that depend only on axial strain and stresses (record,), by name."""
    ratio, end = q / p, critical(strain)

    def at(x: float) -> float:
        near = np.abs(strain - x) <= AROUND
        return float(ratio[near].mean()) if near.any() else np.nan

    return {
        "ratio_1": at(0.01),
        "ratio_5": at(0.05),
        "ratio_peak": max_of_means(strain, ratio),
        "ratio_critical": float(ratio[end].mean()),
        "pressure_critical": float(p[end].mean()),
    }


def max_of_means(strain: np.ndarray, values: np.ndarray) -> float:
    """Largest mean over a window of strain of width PEAK: the peak of a noisy curve."""
    first = np.searchsorted(strain, strain - PEAK)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    means = (sums[1:] - sums[first]) / (np.arange(len(values)) + 1 - first)
    whole = strain - strain[0] >= PEAK
    return float(means[whole].max())
