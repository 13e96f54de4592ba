"""The state under isotropic stress after shear in another direction: is F = -A [I + 4/7 A]^-1?"""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.curves import each_run
from analysis.initial_fabric.loading import ANGLES, specimen_of
from analysis.statistics import cluster_mean, corrected
from labkit.micro import deviator, equivalent_stress, mean_stress, symmetric


def axis_of(angle: float) -> np.ndarray:
    """Unit vector in the plane xz at an angle (degrees) from z, (3,)."""
    return np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])


def balancing_force(A: np.ndarray, Ft: np.ndarray) -> np.ndarray:
    """F that makes the stress isotropic to first order in A, (3, 3): -(A + 15/2 F^t) [I + 4/7 A]^-1.

    From C0, 2/15 A + 2/15 F + 8/105 sym(FA) + F^t = 0; with F^t = 0 it is section 5.3's F^0.
    """
    return deviator(-(A + 7.5 * Ft) @ np.linalg.inv(np.eye(3) + 4.0 / 7.0 * A))


def along(n: np.ndarray, A: np.ndarray, F: np.ndarray, Ft: np.ndarray) -> dict[str, float]:
    """Components along the unit vector n (3,): A, F, Ft, F_paper (section 5.3's F^0) and F_with_Ft (F^0 with F^t)."""
    Ft = symmetric(Ft)
    tensors = {"A": A, "F": F, "Ft": Ft, "F_paper": balancing_force(A, np.zeros((3, 3)))}
    tensors["F_with_Ft"] = balancing_force(A, Ft)
    return {name: float(n @ tensor @ n) for name, tensor in tensors.items()}


def state_table(data: xr.Dataset) -> pandas.DataFrame:
    """The state at the start of the CR test, a row per run.

    A, F and Ft are components along the axis of the previous shear (z without one), as are F_paper, of section 5.3's
    F^0, and F_with_Ft, of F^0 with F^t. p is in kPa; ratio and ratio_C0 are q/p of Love's stress and of C0. The other
    columns are Z, Lambda and e.
    """
    rows = []
    for name, run in each_run(data):
        test = name.partition("-")[0]
        n = axis_of(ANGLES.get(test, 0.0))
        A, F, Ft = (run[key].values.astype(float) for key in ("A", "F", "Ft"))
        stress, predicted = run["stress"].values.astype(float), run["stress_sff"].values.astype(float)
        rows.append(
            {
                "run": name,
                "test": test,
                "specimen": specimen_of(name),
                **along(n, A, F, Ft),
                "p": float(mean_stress(stress)) / 1e3,
                "ratio": float(equivalent_stress(stress) / mean_stress(stress)),
                "ratio_C0": float(equivalent_stress(predicted) / mean_stress(predicted)),
                **{key: float(run[key][0]) for key in ("Z", "Lambda", "e")},
            }
        )
    return pandas.DataFrame(rows)


def balance_table(after: pandas.DataFrame) -> pandas.DataFrame:
    """Means over the specimens of components `along` an axis, and how they balance to an isotropic stress.

    Columns: quantity, value, within (95 %), specimens, p_value (that it is zero), corrected (Holm). share of
    F, of F^t: parts of -A that F and 15/2 F^t balance, so that the anisotropy of the contacts causes no stress.
    """
    quantities = {
        "A": after["A"],
        "F": after["F"],
        "7.5 Ft": 7.5 * after["Ft"],
        "F of section 5.3": after["F_paper"],
        "F - F of section 5.3": after["F"] - after["F_paper"],
        "F - F with F^t": after["F"] - after["F_with_Ft"],
        "share of F": -after["F"] / after["A"],
        "share of F^t": -7.5 * after["Ft"] / after["A"],
    }
    rows = []
    for name, values in quantities.items():
        found = cluster_mean(values, after["specimen"])
        rows.append({"quantity": name, **found.columns("value")})
    return corrected(rows, ["quantity", "value", "within", "specimens", "p_value"])
