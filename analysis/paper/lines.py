"""Critical state lines e(p), Z^c(e) and Lambda^c(e), and a test of whether CV, CR and CP tests end on the same line."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import pandas
from numpy.typing import ArrayLike
from scipy import optimize, stats

import labkit as lk
from analysis.paper.estimates import jackknife
from analysis.statistics import student
from labkit.micro import mean_stress
from labkit.model import ROOT_3_2, Parameters, critical_coordination_number, critical_force, density_distance
from labkit.runs import SHEAR
from labkit.sff import c0_stress

PAPER = Parameters()
SCATTER = np.array([0.05, 2e-4])  # of Z and Lambda at the end of a test: weights of the joint fit of both lines
LineParameters: TypeAlias = Parameters | types.SimpleNamespace


def critical_Z(e: ArrayLike, parameters: LineParameters = PAPER) -> np.ndarray:
    """Z^c(e) from Table 2 or other Parameters of the model; 4 for e >= e_cmax."""
    return critical_coordination_number(np.asarray(e, dtype=float), parameters)


def critical_Lambda(e: ArrayLike, parameters: LineParameters = PAPER) -> np.ndarray:
    """Lambda^c(e) from Table 2 or other Parameters; 0 for e >= e_cmax."""
    return critical_force(np.asarray(e, dtype=float), parameters)


def critical_stress(e: ArrayLike, parameters: Parameters = PAPER) -> np.ndarray:
    """Critical-state stress (..., 3, 3), Pa, in compression along z at void ratios (...), from C0."""
    e, c = np.asarray(e, dtype=float), parameters
    A, F, Ft = (norm / ROOT_3_2 * np.diag([-0.5, -0.5, 1.0]) for norm in (c.A_c, c.F_c, c.Ft_c))
    return c0_stress(lk.Scene().young_modulus, critical_Z(e, c), critical_Lambda(e, c), e, A, F, Ft)


def paper_pressure(e: ArrayLike) -> np.ndarray:
    """Critical-state p (MPa) at void ratios of any shape, from C0 with Table 2; 0 for e >= e_cmax."""
    return mean_stress(critical_stress(e)) / 1e6


def paper_e(p: ArrayLike) -> np.ndarray:
    """Critical-state void ratio at p (MPa), from C0 with Table 2; the inverse of paper_pressure."""
    e = np.linspace(0.4, PAPER.e_cmax, 2000)[::-1]
    return np.interp(np.asarray(p, dtype=float), paper_pressure(e), e)


def c_cZ(ends: pandas.DataFrame) -> float:
    """Least-squares c_cZ with the paper's e_cmax and gamma_cZ. `ends`: table from analysis.paper.ends."""
    x = density_distance(ends["e"].to_numpy(dtype=float), PAPER) ** PAPER.gamma_cZ
    return _through_zero(x, ends["Z"] - 4.0)


def c_cLambda(ends: pandas.DataFrame) -> float:
    """Least-squares c_cLambda with the paper's e_cmax."""
    return _through_zero(density_distance(ends["e"].to_numpy(dtype=float), PAPER), ends["Lambda"])


def _through_zero(x: np.ndarray, y: pandas.Series) -> float:
    square = float(np.sum(x * x))
    return float(np.sum(x * y)) / square if square > 0.0 else math.nan


def both_lines(ends: pandas.DataFrame) -> np.ndarray:
    """e_cmax, c_cZ, gamma_cZ and c_cLambda from a joint fit of both lines (4,); NaN for fewer than five tests."""
    return _both_lines(*(tuple(ends[name].astype(float)) for name in ("e", "Z", "Lambda")))


@functools.lru_cache(4096)  # one fit provides four numbers
def _both_lines(*columns: tuple[float, ...]) -> np.ndarray:
    e, Z, Lam = map(np.array, columns)
    if len(e) < 5 or np.ptp(e) < 0.02:
        return np.full(4, np.nan)

    def misfit(x: np.ndarray) -> np.ndarray:
        at = np.minimum(e, x[0] - 1e-9), _parameters(x)  # Z^c has no derivative at e = e_cmax
        return np.concatenate([(critical_Z(*at) - Z) / SCATTER[0], (critical_Lambda(*at) - Lam) / SCATTER[1]])

    start = [PAPER.e_cmax, PAPER.c_cZ, PAPER.gamma_cZ, PAPER.c_cLam]
    return optimize.least_squares(misfit, start, x_scale=[0.01, 1.0, 0.1, 0.01]).x


def e_p_line(ends: pandas.DataFrame) -> np.ndarray:
    """e0, a and b of e = e0 - a p^b with p in MPa (3,); NaN for fewer than five tests."""
    if len(ends) < 5 or np.ptp(ends["p_MPa"]) < 0.1:
        return np.full(3, np.nan)
    p, e = ends["p_MPa"].to_numpy(dtype=float), ends["e"].to_numpy(dtype=float)
    start = [PAPER.e_cmax, 0.06, 0.8]
    bounds = ([0.5, 0.0, 0.2], [1.0, 1.0, 2.0])
    return optimize.least_squares(lambda x: x[0] - x[1] * p ** x[2] - e, start, bounds=bounds, x_scale=start).x


def _parameters(x: np.ndarray) -> types.SimpleNamespace:
    """The four parameters of `both_lines` by name."""
    return types.SimpleNamespace(**dict(zip(("e_cmax", "c_cZ", "gamma_cZ", "c_cLam"), x, strict=True)))


Fit = Callable[[pandas.DataFrame], np.ndarray]
Line = Callable[[np.ndarray, pandas.DataFrame], ArrayLike]
# name -> (parameters, fit, fitted values at the ends of the tests, fitted column)
LINES: dict[str, tuple[tuple[str, ...], Fit, Line, str]] = {
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
    """The fitted lines, a pandas.DataFrame with a row per line and parameter.

    Columns: value, within (95 % half-width), paper and tests. The line e(p) is e = e0 - a p^b with p in MPa.
    """

    def parameter_of(fit: Fit, k: int) -> Callable[[np.ndarray], float]:
        return lambda rows: fit(ends.iloc[rows])[k]

    rows = []
    for line in ("e(p)", "Z(e) and Lambda(e)"):
        names, fit, _, _ = LINES[line[:4]]
        for k, name in enumerate(names):
            estimate = jackknife(parameter_of(fit, k), len(ends), len(names))
            paper = getattr(PAPER, name, math.nan)
            rows.append(
                {
                    "line": line,
                    "parameter": name,
                    "value": estimate.value,
                    "within": estimate.within,
                    "paper": paper,
                    "tests": estimate.n,
                }
            )
    return pandas.DataFrame(rows)


def one_line(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Tests whether all paths end on the same line; a pandas.DataFrame with a row per line of LINES and path.

    offset: distance of the ends of one path from those of all others, with the line refitted at the same time (to
    first order); within: its 95 % half-width; scatter: standard deviation around the line; p_value: of the F test
    that no path has an offset, the same in all rows of a line. NaN for too few tests or a single path.
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
            slopes = _slopes(at, ends, x)
            one, freedom_one = _remainder(slopes, residual)
            apart, freedom = _remainder(np.hstack([slopes, member[:, 1:]]), residual)
            scatter = math.sqrt(one / freedom_one)
            ratio = (one - apart) / (freedom_one - freedom) / (apart / freedom)
            p_value = stats.f.sf(ratio, freedom_one - freedom, freedom)
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


def _slopes(at: Line, ends: pandas.DataFrame, x: np.ndarray) -> np.ndarray:
    """Derivatives of the line with respect to x, (n, parameters), by central differences.

    Parameters without influence are left out.
    """

    def value(x: np.ndarray) -> np.ndarray:
        return np.asarray(at(x, ends), dtype=float)

    steps = np.diag(1e-4 * np.maximum(np.abs(x), 1e-3))
    columns = [(value(x + step) - value(x - step)) / (2.0 * step.sum()) for step in steps]
    return np.array([column for column in columns if column.any()]).T


def _remainder(columns: np.ndarray, values: np.ndarray) -> tuple[float, int]:
    """(residual sum of squares of a linear fit with these columns, degrees of freedom)."""
    fitted, _, rank, _ = np.linalg.lstsq(columns, values, rcond=None)
    return float(np.sum((values - columns @ fitted) ** 2)), len(values) - int(rank)


def _offset(slopes: np.ndarray, own: np.ndarray, residual: np.ndarray) -> tuple[float, float]:
    """(offset of the tests `own` from the others, its half-width)."""
    columns = np.hstack([slopes, own[:, None]])
    size = np.linalg.norm(columns, axis=0)
    squares, freedom = _remainder(columns, residual)
    inverse = np.linalg.pinv((columns / size).T @ (columns / size))
    offset = np.linalg.lstsq(columns, residual, rcond=None)[0][-1]
    error = math.sqrt(squares / freedom * inverse[-1, -1]) / size[-1]
    return float(offset), student(error, freedom)
