"""Error of C0 against the number of grains."""

from __future__ import annotations

import math

import pandas

from analysis.statistics import student

BEGIN = 0.01  # of strain, from which on the error of q is averaged
TOLERANCE = 0.02  # of `labkit verify`, in the Frobenius norm


def c0_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """Error of C0, a row per size.

    Columns: size, grains (mean), specimens, norm (largest of a test, mean over the specimens), norm_within (95 %),
    norm_largest (of all tests), below (number of tests whose largest norm is below TOLERANCE), q (mean relative error
    of a test, mean over the specimens), q_within, q_scatter (standard deviation of one specimen).
    """
    known = curves[curves["c0_norm"].notna()]
    rows = []
    for size, group in known.groupby("size", sort=False):
        norm = group.groupby("run")["c0_norm"].max()
        q = group[group["strain"] >= BEGIN].groupby("run")["c0_q"].mean()
        n = len(norm)
        rows.append(
            {
                "size": size,
                "grains": float(group.groupby("run")["grains"].first().mean()),
                "specimens": n,
                "norm": float(norm.mean()),
                "norm_within": student(float(norm.std(ddof=1)) / math.sqrt(n), n - 1),
                "norm_largest": float(norm.max()),
                "below": int((norm < TOLERANCE).sum()),
                "q": float(q.mean()),
                "q_within": student(float(q.std(ddof=1)) / math.sqrt(n), n - 1),
                "q_scatter": float(q.std(ddof=1)),
            }
        )
    return pandas.DataFrame(rows)
