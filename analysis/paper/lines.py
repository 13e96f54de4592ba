"""Critical state lines e(p), Z^c(e) and Lambda^c(e), and whether all paths and densities end on one line."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas
from numpy.typing import ArrayLike
from scipy import optimize
from statsmodels.tools.numdiff import approx_fprime

import labkit as lk
from analysis.paper.specimens import density_of, specimens_of
from analysis.statistics import adjusted_once, jackknife
from analysis.statistics.one_line import one_line as test_of_one_line
from labkit.micro import mean_stress
from labkit.model import ROOT_3_2, Parameters, critical_coordination_number, critical_force, density_distance
from labkit.sff import c0_stress

PAPER = Parameters()
SCATTER = np.array([0.05, 2e-4])  # scatter of Z and Lambda at the end of a test, the weights of the joint fit


class CriticalLines(NamedTuple):
    """Parameters of the critical state lines Z^c(e) and Lambda^c(e)."""

    e_cmax: float
    c_cZ: float
    gamma_cZ: float
    c_cLam: float


def critical_Z(e: ArrayLike, parameters: Parameters | CriticalLines = PAPER) -> np.ndarray:
    """Z^c(e) from Table 2 or other Parameters of the model; 4 for e >= e_cmax."""
    return critical_coordination_number(np.asarray(e, dtype=float), parameters)


def critical_Lambda(e: ArrayLike, parameters: Parameters | CriticalLines = PAPER) -> np.ndarray:
    """Lambda^c(e) from Table 2 or other Parameters; 0 for e >= e_cmax."""
    return critical_force(np.asarray(e, dtype=float), parameters)


def off_the_lines(table: pandas.DataFrame) -> pandas.DataFrame:
    """The table with Z_off and Lambda_off, the distances of its Z and Lambda from the lines of Table 2 at its e."""
    Z_off, Lambda_off = table["Z"] - critical_Z(table["e"]), table["Lambda"] - critical_Lambda(table["e"])
    return table.assign(Z_off=Z_off, Lambda_off=Lambda_off)


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
        at = np.minimum(e, x[0] - 1e-9), CriticalLines(*x)  # Z^c has no derivative at e = e_cmax
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


Fit = Callable[[pandas.DataFrame], np.ndarray]
Line = Callable[[np.ndarray, pandas.DataFrame], ArrayLike]
# name -> (parameters, fit, fitted values at the ends of the tests, fitted column)
LINES: dict[str, tuple[tuple[str, ...], Fit, Line, str]] = {
    "e(p)": (("e0", "a", "b"), e_p_line, lambda x, t: x[0] - x[1] * t["p_MPa"] ** x[2], "e"),
    "Z(e)": (CriticalLines._fields, both_lines, lambda x, t: critical_Z(t["e"], CriticalLines(*x)), "Z"),
    "Lambda(e)": (CriticalLines._fields, both_lines, lambda x, t: critical_Lambda(t["e"], CriticalLines(*x)), "Lambda"),
}


def critical_lines(ends: pandas.DataFrame) -> pandas.DataFrame:
    """The fitted lines, a pandas.DataFrame with a row per line and parameter.

    Columns: value, within (95 % half-width over specimens), paper, tests and specimens. The line e(p) is
    e = e0 - a p^b with p in MPa.
    """
    return line_parameters(ends, specimens_of(ends["run"]), ("e(p)", "Z(e) and Lambda(e)"))


def line_parameters(ends: pandas.DataFrame, specimens: Sequence[str], lines: Sequence[str]) -> pandas.DataFrame:
    """The table of critical_lines. lines: names that begin with one of LINES."""
    rows = []
    for line in lines:
        names, fit, _, _ = LINES[line[:4]]
        for k, name in enumerate(names):
            found = jackknife(lambda rows, fit=fit, k=k: fit(ends.iloc[rows])[k], len(ends), len(names), specimens)  # type: ignore[misc]
            paper = getattr(PAPER, name, math.nan)
            rows.append((line, name, found.value, found.within, paper, len(ends), found.n))
    return pandas.DataFrame(rows, columns="line parameter value within paper tests specimens".split())


FACTORS: dict[str, Callable[[pandas.DataFrame], list[str]]] = {  # factor -> group of each test
    "path": lambda ends: ends["path"].astype(str).tolist(),
    "density": lambda ends: [density_of(str(run)) for run in ends["run"]],
}


def one_line(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Tests whether all paths, and all densities, end on the same line; a row per line of LINES, factor and group.

    `tests` and `specimens` count those of the group. `offset` is the distance of its ends from those of all others,
    with the line refitted at the same time (to first order), and `within` its 95 % half-width. `scatter` is the
    standard deviation around the line, and `shared` the part of that variance which the tests of one specimen share.
    `p_value` comes from the test that no group has an offset (analysis.statistics), the same in all rows of a
    line and factor, `corrected` for the number of tests (Holm). Values are NaN for too few tests or a single group.
    """
    rows = []
    specimens = specimens_of(ends["run"])
    for line, (_, fit, at, column) in LINES.items():
        x = fit(ends)
        fitted = bool(np.isfinite(x).all())
        residual = ends[column].to_numpy(dtype=float) - np.asarray(at(x, ends), dtype=float) if fitted else np.zeros(0)
        slopes = line_slopes(at, ends, x) if fitted else np.zeros((0, 1))
        for factor, group_of in FACTORS.items():
            groups = group_of(ends)
            found = test_of_one_line(residual, slopes, np.array(groups), specimens) if fitted else None
            offsets = found.offsets.set_index("group") if found else pandas.DataFrame()
            for group in dict.fromkeys(groups):
                known = offsets.loc[group] if group in offsets.index else {}
                own = {s for s, g in zip(specimens, groups, strict=True) if g == group}
                offset = (known.get(name, math.nan) for name in ("offset", "within"))
                of_line = (found.scatter, found.shared, found.p_value) if found else [math.nan] * 3
                rows.append((line, factor, group, groups.count(group), len(own), *offset, *of_line))
    columns = "line factor group tests specimens offset within scatter shared p_value".split()
    table = pandas.DataFrame(rows, columns=columns)
    table["corrected"] = adjusted_once(table, ["line", "factor"])
    return table


def line_slopes(at: Line, ends: pandas.DataFrame, x: np.ndarray) -> np.ndarray:
    """Derivatives of the line with respect to x, (n, parameters), by central differences.

    Parameters without influence are left out.
    """

    def value(x: np.ndarray) -> np.ndarray:
        return np.asarray(at(x, ends), dtype=float)

    slopes = approx_fprime(x, value, 2e-4 * np.maximum(np.abs(x), 1e-3), centered=True)
    return slopes[:, slopes.any(axis=0)]
