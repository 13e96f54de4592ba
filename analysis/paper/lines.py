"""Critical state lines: e over p, Z^c(e) and Lambda^c(e), and whether the ends of CV, CR and CP tests lie on one."""

from __future__ import annotations

import functools
import math
import types

import numpy as np
import pandas
from scipy import optimize, stats

import labkit as lk
from analysis import intervals
from analysis.paper.estimates import jackknife
from labkit.micro import mean_stress
from labkit.model import ROOT_3_2, Parameters, critical_coordination_number, critical_force, density_distance
from labkit.runs import SHEAR
from labkit.sff import c0_stress

PAPER = Parameters()
SCATTER = np.array([0.05, 2e-4])  # of Z and Lambda in a test's end: the weights of the two lines fitted at once


def critical_Z(e: np.ndarray, parameters: Parameters = PAPER) -> np.ndarray:
    """Z^c(e), of Table 2 or other Parameters of the model; 4 from e_cmax on."""
    return critical_coordination_number(np.asarray(e, dtype=float), parameters)


def critical_Lambda(e: np.ndarray, parameters: Parameters = PAPER) -> np.ndarray:
    """Lambda^c(e), of Table 2 or other Parameters; 0 from e_cmax on."""
    return critical_force(np.asarray(e, dtype=float), parameters)


def critical_stress(e: np.ndarray, parameters: Parameters = PAPER) -> np.ndarray:
    """Stress (..., 3, 3), Pa, of the critical state in compression along z at void ratios (...) after C0."""
    e, c = np.asarray(e, dtype=float), parameters
    A, F, Ft = (norm / ROOT_3_2 * np.diag([-0.5, -0.5, 1.0]) for norm in (c.A_c, c.F_c, c.Ft_c))
    return c0_stress(lk.Scene().young_modulus, critical_Z(e, c), critical_Lambda(e, c), e, A, F, Ft)


def paper_pressure(e: np.ndarray) -> np.ndarray:
    """p (MPa) of the critical state at a void ratio after C0 with Table 2, any shape; 0 from e_cmax on."""
    return mean_stress(critical_stress(e)) / 1e6


def paper_e(p: np.ndarray) -> np.ndarray:
    """The void ratio of the critical state at p (MPa) after C0 with Table 2: the inverse of paper_pressure."""
    e = np.linspace(0.4, PAPER.e_cmax, 2000)[::-1]
    return np.interp(p, paper_pressure(e), e)


def c_cZ(ends: pandas.DataFrame) -> float:
    """c_cZ alone, with the paper's e_cmax and gamma_cZ, by least squares. `ends`: of analysis.paper.ends."""
    x = density_distance(ends["e"].to_numpy(dtype=float), PAPER) ** PAPER.gamma_cZ
    return _through_zero(x, ends["Z"] - 4.0)


def c_cLambda(ends: pandas.DataFrame) -> float:
    """c_cLambda alone, with the paper's e_cmax, by least squares."""
    return _through_zero(density_distance(ends["e"].to_numpy(dtype=float), PAPER), ends["Lambda"])


def _through_zero(x, y):
    square = float(np.sum(x * x))
    return float(np.sum(x * y)) / square if square > 0.0 else math.nan


def both_lines(ends: pandas.DataFrame) -> np.ndarray:
    """e_cmax, c_cZ, gamma_cZ and c_cLambda of both lines at once, an array (4,); NaN from fewer than five tests."""
    return _both_lines(*(tuple(ends[name].astype(float)) for name in ("e", "Z", "Lambda")))


@functools.lru_cache(4096)  # four numbers are made of one fit
def _both_lines(*columns):
    e, Z, Lam = map(np.array, columns)
    if len(e) < 5 or np.ptp(e) < 0.02:
        return np.full(4, np.nan)

    def misfit(x):
        at = np.minimum(e, x[0] - 1e-9), _parameters(x)  # where e_cmax - e = 0, Z^c would have no derivative
        return np.concatenate([(critical_Z(*at) - Z) / SCATTER[0], (critical_Lambda(*at) - Lam) / SCATTER[1]])

    start = [PAPER.e_cmax, PAPER.c_cZ, PAPER.gamma_cZ, PAPER.c_cLam]
    return optimize.least_squares(misfit, start, x_scale=[0.01, 1.0, 0.1, 0.01]).x


def e_p_line(ends: pandas.DataFrame) -> np.ndarray:
    """e0, a and b of e = e0 - a p^b, p in MPa, an array (3,); NaN from fewer than five tests."""
    if len(ends) < 5 or np.ptp(ends["p_MPa"]) < 0.1:
        return np.full(3, np.nan)
    p, e = ends["p_MPa"].to_numpy(dtype=float), ends["e"].to_numpy(dtype=float)
    start = [PAPER.e_cmax, 0.06, 0.8]
    bounds = ([0.5, 0.0, 0.2], [1.0, 1.0, 2.0])
    return optimize.least_squares(lambda x: x[0] - x[1] * p ** x[2] - e, start, bounds=bounds, x_scale=start).x


def _parameters(x):
    """Parameters with the four of `both_lines`."""
    return types.SimpleNamespace(**dict(zip(("e_cmax", "c_cZ", "gamma_cZ", "c_cLam"), x, strict=True)))


# name -> (parameters, fit, what it gives at the ends, the column that it is a line of)
LINES = {
    "e(p)": (("e0", "a", "b"), e_p_line, lambda x, t: x[0] - x[1] * t["p_MPa"] ** x[2], "e"),
    "Z(e)": (
        ("e_cmax", "c_cZ", "gamma_cZ", "c_cLam"),
        both_lines,
        lambda x, t: critical_Z(t["e"], _parameters(x)),
        "Z",
    ),
    "Lambda(e)": (
        ("e_cmax", "c_cZ", "gamma_cZ", "c_cLam"),
        both_lines,
        lambda x, t: critical_Lambda(t["e"], _parameters(x)),
        "Lambda",
    ),
}


def critical_lines(ends: pandas.DataFrame) -> pandas.DataFrame:
    """The fitted lines, a pandas.DataFrame with a row per line and parameter: value, within (95 %), scatter of the ends
    around the line, and tests. Parameters of e(p) are those of e = e0 - a p^b with p in MPa.
    """
    rows = []
    for line in ("e(p)", "Z(e) and Lambda(e)"):
        names, fit, _, _ = LINES[line[:4]]
        for k, name in enumerate(names):
            found = jackknife(lambda rows: fit(ends.iloc[rows])[k], len(ends), len(names))
            paper = getattr(PAPER, name, math.nan)
            rows.append(
                {
                    "line": line,
                    "parameter": name,
                    "value": found.value,
                    "within": found.within,
                    "paper": paper,
                    "tests": found.n,
                }
            )
    return pandas.DataFrame(rows)


def one_line(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Whether the ends of the paths lie on one line, a pandas.DataFrame with a row per line of LINES and path.

    offset: of the ends of a path from those of all others, the line fitted again beside it (to first order), and its
    95 % half-width `within`; scatter: standard deviation around the line; p_value: of the F test that no path has an
    offset of its own, the same in all rows of a line. NaN where there are too few tests or one path alone.
    """
    rows = []
    kinds = [path for path in SHEAR if (ends["path"] == path).any()]
    member = np.array([ends["path"] == path for path in kinds], dtype=float).T
    for line, (names, fit, at, column) in LINES.items():
        x = fit(ends)
        fitted = np.isfinite(x).all() and len(kinds) > 1 and len(ends) > len(names) + len(kinds)
        scatter = p_value = math.nan
        if fitted:
            residual = ends[column].to_numpy(dtype=float) - np.asarray(at(x, ends), dtype=float)
            slopes = _slopes(lambda x: np.asarray(at(x, ends), dtype=float), x)
            alone, freedom_alone = _left(slopes, residual)
            apart, freedom = _left(np.hstack([slopes, member[:, 1:]]), residual)
            scatter = math.sqrt(alone / freedom_alone)
            p_value = stats.f.sf(
                (alone - apart) / (freedom_alone - freedom) / (apart / freedom), freedom_alone - freedom, freedom
            )
        for k, path in enumerate(kinds):
            offset, within = _offset(slopes, member[:, k], residual) if fitted else (math.nan, math.nan)
            rows.append(
                {
                    "line": line,
                    "path": path,
                    "tests": int(member[:, k].sum()),
                    "offset": offset,
                    "within": within,
                    "scatter": scatter,
                    "p_value": float(p_value),
                }
            )
    return pandas.DataFrame(rows, columns=["line", "path", "tests", "offset", "within", "scatter", "p_value"])


def _slopes(at, x):
    """d at/d x, (n, parameters), by central differences; parameters without influence are left out."""
    steps = np.diag(1e-4 * np.maximum(np.abs(x), 1e-3))
    columns = [(at(x + step) - at(x - step)) / (2.0 * step.sum()) for step in steps]
    return np.array([column for column in columns if column.any()]).T


def _left(columns, values):
    """(sum of squares that a linear fit by these columns leaves, degrees of freedom)."""
    found, _, rank, _ = np.linalg.lstsq(columns, values, rcond=None)
    return float(np.sum((values - columns @ found) ** 2)), len(values) - rank


def _offset(slopes, own, residual):
    """(offset of the tests `own` from the others, its half-width)."""
    columns = np.hstack([slopes, own[:, None]])
    size = np.linalg.norm(columns, axis=0)
    left, freedom = _left(columns, residual)
    inverse = np.linalg.pinv((columns / size).T @ (columns / size))
    offset = np.linalg.lstsq(columns, residual, rcond=None)[0][-1]
    error = math.sqrt(left / freedom * inverse[-1, -1]) / size[-1]
    return float(offset), intervals.student(error, freedom)
