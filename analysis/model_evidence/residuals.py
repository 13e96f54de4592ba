"""What C1 to C5 do not explain: residuals of their increments against further quantities, cross-validated by path."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pandas

from analysis.model_evidence import increments
from analysis.model_evidence.errors import judged
from analysis.statistics import cluster_mean

Candidate = Callable[[increments.Increments, increments.Lines], np.ndarray]  # increments (steps,)
OF_TENSORS: dict[str, Candidate] = {
    "A": lambda d, c: d.state["A"] * d.s,
    "F": lambda d, c: d.state["F"] * d.s,
    "F^t": lambda d, c: d.state["T"] * d.s,
    "F - F^c/A^c A": lambda d, c: (d.state["F"] - 0.757 / 0.446 * d.state["A"]) * d.s,
    "Z - Z^c": lambda d, c: d.n * (d.state["Z"] - c.Zc) * d.s,
    "(Lambda - Lambda^c)/Lambda": lambda d, c: d.n * (1.0 - c.Lc / d.state["L"]) * d.s,
    "A, volumetric": lambda d, c: d.state["A"] * d.v,
    "F, volumetric": lambda d, c: d.state["F"] * d.v,
    "F^t, volumetric": lambda d, c: d.state["T"] * d.v,
}
OF_SCALARS: dict[str, Candidate] = {
    "A:n - A^c": lambda d, c: (d.state["A"] * d.n - 0.446) * d.s,
    "F:n - F^c": lambda d, c: (d.state["F"] * d.n - 0.757) * d.s,
    "q/p - M": lambda d, c: increments.excess(d) * d.s,
    "Lambda (A:n - A^c)": lambda d, c: d.state["L"] * (d.state["A"] * d.n - 0.446) * d.s,
    "Lambda (F:n - F^c)": lambda d, c: d.state["L"] * (d.state["F"] * d.n - 0.757) * d.s,
    "Lambda (q/p - M)": lambda d, c: d.state["L"] * increments.excess(d) * d.s,
    "Z - Z^c": lambda d, c: (d.state["Z"] - c.Zc) * d.s,
    "Lambda - Lambda^c": lambda d, c: (d.state["L"] - c.Lc) * d.s,
    "volumetric": lambda d, c: d.v,
}


def missing_elements(data: increments.Increments, fitted: np.ndarray) -> pandas.DataFrame:
    """Do further quantities explain the residual of an equation? A table with a row per equation and candidate.

    For each path the equation and the coefficient of the candidate are fitted to the tests along all other paths and
    judged on this path. `gain` is 1 - (sum of squares with the candidate)/(without), the geometric mean over specimens;
    `low` and `high` bound its 95 % interval. `p_value` comes from a t test over specimens that the gain is zero,
    `corrected` for the number of rows (Holm). A column per path gives the gain there. `explained` is the share of the
    squared changes that the equation explains on the left-out paths, the median over tests. The argument `fitted` holds
    the parameters of the lines.
    """
    lines, rows = increments.lines_of(data, fitted), []
    for equation, (rate, variable, start) in increments.EQUATIONS.items():
        candidates = OF_SCALARS if variable in "ZL" else OF_TENSORS
        paths = [path for path in dict.fromkeys(data.path) if variable in "ZL" or path not in increments.ISOTROPIC]
        parts = []
        for path in paths:
            own = data.path == path
            residual = data.change[variable] - data.total(
                rate(increments.fit_rate(rate, variable, start, data, lines, ~own), data, lines)
            )
            for name, candidate in candidates.items():
                extra = data.total(candidate(data, lines))
                part = float(extra[~own] @ residual[~own]) / float(extra[~own] @ extra[~own])
                parts.append(_by_run(data, own, residual, residual - part * extra, variable).assign(candidate=name))
        table = pandas.concat(parts)
        explained = float((1.0 - table["before"] / table["size"]).median())
        for name, group in table.groupby("candidate", sort=False):
            rows.append({"equation": equation, "explained": explained, "candidate": name, **_gain(group, paths)})
    table = pandas.DataFrame(rows)
    return judged(table, table["gain"] > 0.0)


def forms_of_c4(data: increments.Increments, fitted: np.ndarray) -> pandas.DataFrame:
    """Forms of C4, each fitted to all other paths and judged on one, a pandas.DataFrame with a row per form.

    Also the paper's form with the reported void ratio in Lambda^c. explained_PATH: share of the squared changes of
    Lambda on the left-out path that the form explains (median over its tests); gain, low, high: over the paper's form,
    as in missing_elements. There is no p-value: the forms were chosen with these tests.
    """
    nominal, rows = increments.lines_of(data, fitted), []
    before: dict[str, np.ndarray] = {}
    forms = {name: (form, nominal) for name, form in increments.C4_FORMS.items()}
    forms["reported void ratio"] = increments.C4_FORMS["paper"], increments.lines_of(data, fitted, "reported")
    paths = list(dict.fromkeys(data.path))
    for name, ((rate, start), lines) in forms.items():
        parts, explained = [], {}
        for path in paths:
            own = data.path == path
            found = increments.fit_rate(rate, "L", start, data, lines, ~own)
            residual = data.change["L"] - data.total(rate(found, data, lines))
            part = _by_run(data, own, before.setdefault(path, residual), residual, "L")
            explained[f"explained_{path}"] = float((1.0 - part["after"] / part["size"]).median())
            parts.append(part)
        rows.append({"form": name, **explained, **_gain(pandas.concat(parts), paths)})
    rows[0] |= dict.fromkeys(("gain", "low", "high"), math.nan)  # the paper's form compared with itself
    return pandas.DataFrame(rows).drop(columns="p_value")


def _by_run(
    data: increments.Increments, own: np.ndarray, before: np.ndarray, after: np.ndarray, variable: str
) -> pandas.DataFrame:
    """Sums of squares of the changes and of two residuals, a row per test on the left-out path."""
    labels = {name: getattr(data, name)[own] for name in ("run", "specimen", "path")}
    values = {"size": data.change[variable], "before": before, "after": after}
    squares = pandas.DataFrame(labels | {name: value[own] ** 2 for name, value in values.items()})
    return squares.groupby(list(labels), sort=False).sum().reset_index()


def _gain(table: pandas.DataFrame, paths: Sequence[str]) -> dict[str, float]:
    ratio = np.log((table["after"] / table["before"]).to_numpy(dtype=float))
    found = cluster_mean(ratio, table["specimen"])
    by_path = {str(path): 1.0 - math.exp(ratio[(table["path"] == path).to_numpy()].mean()) for path in paths}
    return {
        "tests": len(table),
        "specimens": found.n,
        "gain": 1.0 - math.exp(found.value),
        "low": 1.0 - math.exp(found.value + found.within),
        "high": 1.0 - math.exp(found.value - found.within),
        "p_value": found.p_value,
        **by_path,
    }
