"""Strength at the end of each path: M against the intermediate stress, M_e/M_c, the model and Matsuoka and Nakai."""

from __future__ import annotations

import math

import numpy as np
import pandas
import xarray as xr
from scipy import optimize

import labkit as lk
from analysis.curves import each_run
from analysis.statistics import Tested, cluster_mean
from labkit.micro import equivalent_stress, mean_stress, symmetric
from labkit.model import Model, drive, isotropic_state

WINDOW = 0.25  # the last quarter of the accumulated strain


def end_table(data: xr.Dataset) -> pandas.DataFrame:
    """State at the end of each run, a pandas.DataFrame with a row per run: means over the last quarter of its strain.

    M = q/p with q = sqrt(3/2)|s|; b = (s2 - s3)/(s1 - s3); slope: of M against the accumulated strain, per 0.1.
    """
    rows = []
    for _, run in each_run(data):
        t = run["accumulated_strain"].values.astype(float)
        last = t >= (1.0 - WINDOW) * t[-1]
        stress = run["stress"].values.astype(float)[last]
        M = equivalent_stress(stress) / mean_stress(stress)
        mean = stress.mean(axis=0)
        s3, s2, s1 = np.linalg.eigvalsh(symmetric(mean))
        rows.append(
            {
                "test": str(run["test"].values),
                "specimen": str(run["specimen"].values),
                "b": (s2 - s3) / (s1 - s3),
                "M": float(M.mean()),
                "slope": float(np.polyfit(t[last], M, 1)[0] / 10.0),
                "p_MPa": float(mean_stress(mean) / 1e6),
                "e": float(run["void_ratio"].values[last].mean()),
                "Z": float(run["coordination_number"].values[last].mean()),
            }
        )
    return pandas.DataFrame(rows)


def mean_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Mean M of each test over its specimens with the 95 % half-width, and whether M is stationary over the window.

    `slope` is the mean over the specimens, per 0.1 of accumulated strain; `p_slope` is the p-value of the t-test that
    it is zero.
    """
    rows = []
    for test, group in ends.groupby("test", sort=False):
        M, slope = cluster_mean(group["M"]), cluster_mean(group["slope"])
        row = {"test": test, "specimens": M.n, "b": group["b"].mean(), "M": M.value, "within": M.within}
        rows.append(row | {"slope": slope.value, "p_slope": slope.p_value})
    return pandas.DataFrame(rows)


def strength_ratio(ends: pandas.DataFrame) -> Tested:
    """M_e/M_c over the specimens tested in both extension and compression."""
    table = ends.pivot_table(index="specimen", columns="test", values="M")[["extension", "compression"]].dropna()
    return cluster_mean(table["extension"] / table["compression"])


def principal_stresses(b: float, M: float) -> np.ndarray:
    """Principal stresses (3,) over the mean stress, descending, for b = (s2 - s3)/(s1 - s3) and M = q/p."""
    d = M / math.sqrt(1.0 - b + b * b)  # (s1 - s3)/p
    least = 1.0 - d * (1.0 + b) / 3.0
    return np.array([least + d, least + b * d, least])


def matsuoka_nakai(b: np.ndarray, compression: float) -> np.ndarray:
    """M(b) by Matsuoka and Nakai (1974), I1 I2/I3 constant, through M = `compression` at b = 0; shape of b."""

    def invariant(M: float, b: float) -> float:
        s = principal_stresses(b, M)
        return 3.0 * (s[0] * s[1] + s[1] * s[2] + s[2] * s[0]) / np.prod(s)

    reference = invariant(compression, 0.0)

    def strength(b: float) -> float:
        most = 3.0 * math.sqrt(1.0 - b + b * b) / (1.0 + b)  # where the least principal stress vanishes
        return optimize.brentq(lambda M: invariant(M, b) - reference, 1e-6, most * (1.0 - 1e-9))

    return np.array([strength(float(x)) for x in np.atleast_1d(b)])


def model_strength(model: Model, e: float, Z: float, b: np.ndarray, strain: float = 0.6) -> np.ndarray:
    """M of the constitutive model at the end of true triaxial tests at p = 500 kPa, shape of b.

    e, Z: void ratio and coordination number of the specimens at the start.
    """
    values = []
    for ratio in np.atleast_1d(b):
        state = isotropic_state(model, e, 500e3, Z=Z)
        path = lk.paths.TrueTriaxial(b=float(ratio), pressure=500e3, strain=strain)
        stress = drive(model, path, state).require().stress[-1]
        values.append(float(equivalent_stress(stress) / mean_stress(stress)))
    return np.array(values)
