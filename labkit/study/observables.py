"""What is compared: numbers of a shear test."""

from __future__ import annotations

import numpy as np

from labkit.critical import WINDOW
from labkit.verify import SFF_PRESSURE

# name -> (label, unit, whether its error is relative); those of the critical state are means over the last quarter
OBSERVABLES = {
    "ratio_1": ("q/p at 1 %", "", True),
    "ratio_5": ("q/p at 5 %", "", True),
    "ratio_peak": ("q/p at the peak", "", True),
    "ratio_critical": ("q/p, critical", "", True),
    "void_ratio_critical": ("e, critical", "", True),
    "pressure_critical": ("p, critical", "Pa", True),
    "Z_critical": ("Z, critical", "", True),
    "Lambda_critical": ("Lambda, critical", "", True),
    "A_critical": ("A_zz, critical", "", True),
    "F_critical": ("F_zz, critical", "", True),
    "Ft_critical": ("F^t_zz, critical", "", True),
    "sff_error": ("error of C0", "", False),
}
# what tells whether a test can be believed, beside the observables
CHECKS = {
    "energy_balance_error": ("energy balance, at worst", ""),
    "held_error": ("held stress, RMS error", ""),
    "inertial_number": ("inertial number, mean", ""),
    "overlap_ratio": ("mean overlap over D", ""),
}
AROUND = 0.0025  # axial strain on each side that a value at a strain is the mean of
PEAK = 0.01  # axial strain that the peak is a mean over


def observables(run, held):
    """The numbers of OBSERVABLES and CHECKS of a complete shear test, name -> value; `held`: mean stress held,
    Pa, or None."""
    strain = run["axial_strain"].values
    p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
    ratio, end = q / p, strain >= (1.0 - WINDOW) * strain[-1]
    judged = p > SFF_PRESSURE
    sff = run.lab.sff_error().values[judged]

    def at(x):
        near = np.abs(strain - x) <= AROUND
        return float(ratio[near].mean()) if near.any() else np.nan

    def critical(values):
        return float(np.mean(values[end]))

    def zz(name):
        return critical(run[name].values[:, 2, 2])

    return {
        "ratio_1": at(0.01), "ratio_5": at(0.05), "ratio_peak": max_of_means(strain, ratio),
        "ratio_critical": critical(ratio), "void_ratio_critical": critical(run["void_ratio"].values),
        "pressure_critical": critical(p), "Z_critical": critical(run["coordination_number"].values),
        "Lambda_critical": critical(run["mean_normalised_force"].values), "A_critical": zz("contact_anisotropy"),
        "F_critical": zz("normal_force_anisotropy"), "Ft_critical": zz("mobilisation"),
        "sff_error": float(sff.mean()) if sff.size else np.nan,
        "energy_balance_error": float(np.abs(run["energy_balance_error"].values).max()),
        "held_error": float(np.sqrt(np.mean((p[strain > 2 * AROUND] / held - 1.0) ** 2))) if held else np.nan,
        "inertial_number": float(np.median(run["inertial_number"].values[1:])),
        "overlap_ratio": float(run["overlap_ratio"].values.mean()),
    }  # fmt: skip


def max_of_means(strain, values):
    """The largest mean over PEAK of strain: the peak of a curve that scatters."""
    first = np.searchsorted(strain, strain - PEAK)
    sums = np.concatenate([[0.0], np.cumsum(values)])
    means = (sums[1:] - sums[first]) / (np.arange(len(values)) + 1 - first)
    whole = strain - strain[0] >= PEAK
    return float(means[whole].max())
