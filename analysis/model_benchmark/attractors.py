"""Attractors of A, F and F^t as functions of the Lode angle, measured at the ends of the tests."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.curves import each_run
from analysis.statistics import cluster_mean
from labkit.micro import deviator, lode_angle

LAST = 0.75  # share of a test beyond which its end state is averaged
TENSORS = ("A", "F", "Ft")
MIDDLE = (10.0, 50.0)  # Lode angles of the strain rate between which w is measured, degrees
ENDS = ("simple shear", "b", "compression", "extension")  # groups


def end_states(data: xr.Dataset) -> pandas.DataFrame:
    """The end of each test whose shear does not reverse, a row per run.

    Columns: run, group, part, packing, theta (Lode angle of the strain rate, degrees), stress_theta, M, e, p (Pa), and
    for T of A, F, Ft `T`, its norm, `T_theta`, and `T_n`, `T_m`: its components along n and along N - cos(3 theta) n
    divided by the square of the norm of the latter (NaN at the ends of the range).
    """
    rows = []
    for name, one in each_run(data):
        group = str(one["group"].values)
        along = one["along"].values
        last = along >= LAST * along[-1]
        if group not in ENDS or not np.isfinite(one["A"].values[-1]).all():
            continue
        strain = one["strain"].values.astype(float)[last]
        n = deviator(strain[-1] - strain[0])
        if group == "simple shear":  # the strain rotates with the cell, so take its rate from the path
            n = np.zeros((3, 3))
            n[0, 2] = n[2, 0] = 1.0
        n /= np.linalg.norm(n)
        N = np.sqrt(6.0) * deviator(n @ n)
        side = N - np.sum(N * n) * n
        stress = one["stress"].values.astype(float)[last].mean(axis=0)
        s, p = deviator(stress), np.trace(stress) / 3.0
        theta = float(lode_angle(n))
        row: dict[str, object] = {"run": name, **{key: str(one[key].values) for key in ("group", "part", "packing")}}
        row |= {"theta": theta, "stress_theta": float(lode_angle(stress))}
        row |= {"M": np.sqrt(1.5) * np.linalg.norm(s) / p, "e": float(one["e"].values[last].mean()), "p": p}
        for key in TENSORS:
            T = deviator(one[key].values.astype(float)[last].mean(axis=0))
            middle = MIDDLE[0] < theta < MIDDLE[1]
            turned = np.sum(T * side) / np.sum(side * side) if middle else np.nan
            row |= {key: np.linalg.norm(T), f"{key}_theta": float(lode_angle(T))}
            row |= {f"{key}_n": np.sum(T * n), f"{key}_m": turned}
        rows.append(row)
    return pandas.DataFrame(rows)


def measured_constants(ends: pandas.DataFrame) -> pandas.DataFrame:
    """The constants of labkit.model.parameters.LodeDependence from end states: name, value, within, packings.

    b: half of 1 minus the ratio of the norms in extension and compression of the same packing; w: T_m over the norm in
    compression, minus b; d_e: e in extension minus compression at equal p.
    """
    by_packing = {group: ends[ends["group"] == group].groupby("packing").mean(numeric_only=True) for group in ENDS}
    both = by_packing["compression"].join(by_packing["extension"].add_suffix("_e"), how="inner")
    rows = []
    for key in TENSORS:
        b = cluster_mean(0.5 * (1.0 - both[f"{key}_e"] / both[key]))
        rows.append((f"{key}_b", b.value, b.within, b.n))
        middle = pandas.concat([by_packing["b"], by_packing["simple shear"]])
        w = cluster_mean(middle[f"{key}_m"] / both[key].reindex(middle.index) - b.value, middle.index)
        rows.append((f"{key}_w", w.value, w.within, w.n))
    d = cluster_mean(both["e_e"] - both["e"])
    rows.append(("d_e", d.value, d.within, d.n))
    return pandas.DataFrame(rows, columns=["constant", "value", "within", "packings"])
