"""Error of C0 against Love's stress on each path, in p, q and every component; each specimen counts once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas
import xarray as xr

from analysis.curves import each_run
from analysis.statistics import SIGNIFICANT, cluster_mean, corrected
from labkit.micro import equivalent_stress, mean_stress, symmetric
from labkit.sff import PARTS

REFERENCE = "compression"  # the kind of test in the paper
LEAST_PRESSURE = 50e3  # Pa
LEAST_RATIO = 0.2  # q/p above which the errors of q and of the direction are evaluated
COMPONENTS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "yz": (1, 2), "xz": (0, 2), "xy": (0, 1)}


def direction(stress: np.ndarray) -> np.ndarray:
    """Angle of the major principal stress in the x-z plane from the z axis, degrees, shape (...)."""
    return np.degrees(0.5 * np.arctan2(stress[..., 0, 2] + stress[..., 2, 0], stress[..., 2, 2] - stress[..., 0, 0]))


def errors_of(stress: np.ndarray, love: np.ndarray) -> dict[str, Any]:
    """Return errors of a stress against Love's, both (n, 3, 3), Pa, as means along the test.

    `p`, `q` and `ratio` (of q/p) are relative errors with their sign, and `norm` is the Frobenius norm of the
    difference over that of Love's stress. `xx` to `xy` are root mean squares of the difference over the mean stress,
    and `angle` is the mean absolute difference of the directions of the major principal stress in the x-z plane,
    degrees.
    """
    p, q = mean_stress(love), equivalent_stress(love)
    judged = p > LEAST_PRESSURE
    sheared = judged & (q > LEAST_RATIO * p)
    difference = symmetric(stress) - symmetric(love)
    p_error = mean_stress(stress) / p - 1.0
    q_error = equivalent_stress(stress) / np.where(q > 0.0, q, np.nan) - 1.0
    norm = np.linalg.norm(difference, axis=(-2, -1)) / np.linalg.norm(symmetric(love), axis=(-2, -1))
    turned = np.abs((direction(stress) - direction(love) + 90.0) % 180.0 - 90.0)
    rms = {
        name: float(np.sqrt(np.mean((difference[judged, i, j] / p[judged]) ** 2)))
        for name, (i, j) in COMPONENTS.items()
    }
    return {
        "p": float(p_error[judged].mean()),
        "q": float(q_error[sheared].mean()) if sheared.any() else np.nan,
        "ratio": float(((1.0 + q_error[sheared]) / (1.0 + p_error[sheared]) - 1.0).mean()) if sheared.any() else np.nan,
        "norm": float(norm[judged].mean()),
        "worst": float(norm[judged].max()),
        **rms,
        "angle": float(turned[sheared].mean()) if sheared.any() else np.nan,
    }


def error_table(data: xr.Dataset) -> pandas.DataFrame:
    """Errors of C0, a pandas.DataFrame with a row per run; columns as in `errors_of`; data: result of `collect`."""
    rows = []
    for _, run in each_run(data):
        errors = errors_of(run["stress_sff"].values.astype(float), run["stress"].values.astype(float))
        rows.append({"test": str(run["test"].values), "specimen": str(run["specimen"].values), **errors})
    return pandas.DataFrame(rows)


def form_table(data: xr.Dataset) -> pandas.DataFrame:
    """Errors of the equations related to C0 at the snapshots, a row per test and form: means over the specimens."""
    rows = []
    for _, one in each_run(data):
        run = one.dropna("snapshot", subset=["snapshot_accumulated"])
        love = run["snapshot_stress"].values.astype(float)
        for form in run["form"].values:
            values = errors_of(run["stress_family"].sel(form=form).values.astype(float), love)
            rows.append(
                {"test": str(run["test"].values), "form": str(form), **{k: values[k] for k in ("p", "q", "norm")}}
            )
    return pandas.DataFrame(rows).groupby(["test", "form"], sort=False).mean().reset_index()


def budget_table(data: xr.Dataset) -> pandas.DataFrame:
    """Contribution of each assumption of C0 to its error in p and in q, over p and q; a row per test and part.

    Means over the snapshots with q > 0.2 p, then over the specimens. The contribution to q is the projection on the
    direction of Love's deviator, so that the parts add up.
    """
    rows = []
    for _, one in each_run(data):
        run = one.dropna("snapshot", subset=["snapshot_accumulated"])
        love = run["snapshot_stress"].values.astype(float)
        p, q = mean_stress(love), equivalent_stress(love)
        kept = (p > LEAST_PRESSURE) & (q > LEAST_RATIO * p)
        deviator = love - p[:, None, None] * np.eye(3)
        for part in PARTS:
            share = run["error_budget"].sel(part=part).values.astype(float)
            along = 1.5 * np.einsum("nij,nij->n", share, deviator) / q**2
            rows.append(
                {
                    "test": str(run["test"].values),
                    "part": part,
                    "p": float((mean_stress(share) / p)[kept].mean()),
                    "q": float(along[kept].mean()),
                }
            )
    return pandas.DataFrame(rows).groupby(["test", "part"], sort=False).mean().reset_index()


def comparison(errors: pandas.DataFrame) -> pandas.DataFrame:
    """Is C0 less accurate on a path than in compression? A row per test and quantity (p, q).

    A specimen counts once: `difference` is the mean over the specimens of the absolute error on the path minus that in
    compression on the same specimen, `within` its 95 % half-width (paired t), `limit` the largest difference that the
    interval allows, `p_value` of the paired t-test, and `corrected` the same after Benjamini and Hochberg over all
    rows.
    """
    rows = []
    for quantity in ("p", "q"):
        table = errors.pivot_table(index="specimen", columns="test", values=quantity).abs()
        for test in table.columns.drop(REFERENCE):
            mean = cluster_mean((table[test] - table[REFERENCE]).to_numpy())
            rows.append({"test": test, "quantity": quantity, **mean.columns("difference")})
    frame = corrected(rows, method="fdr_bh")
    frame.insert(5, "limit", frame["difference"].abs() + frame["within"])
    conditions = [frame["corrected"].isna(), frame["corrected"] > SIGNIFICANT, frame["difference"] > 0]
    found = np.select(conditions, ["not tested", "not resolved", "less accurate"], "more accurate")
    return frame.assign(verdict=found)
