"""Scatter against the number of grains, its exponent, the bias of small specimens, and the error of C0."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas
from scipy import optimize, stats
from statsmodels.genmod.families import Gamma
from statsmodels.genmod.families.links import Log
from statsmodels.genmod.generalized_linear_model import GLM
from statsmodels.regression.linear_model import WLS

from analysis.statistics import CONFIDENCE, Tested, adjusted, cluster_mean, corrected, with_verdict

MEASURED = ("M", "A", "F", "Ft", "Z", "Lambda", "p_MPa")
BIAS = {"1/N": 1.0, "1/N^(1/3)": 1.0 / 3.0}  # model of the bias -> exponent
SMALL = 1000  # grains at which the bias is quoted
HALF = 0.5  # exponent of independent grains
ALLOWED = 0.01  # relative scatter of one specimen for which the table gives the number of grains
BEGIN = 0.01  # strain from which the error of q is averaged
TOLERANCE = 0.02  # tolerance of `labkit verify`, in the Frobenius norm
LIMIT = float(stats.chi2.ppf(CONFIDENCE, 1))  # 95 % quantile of a likelihood ratio
FAR = 1.0  # maximum distance of an exponent from the ends of its interval


def size_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Means and scatter, a row per quantity and size.

    Columns: quantity, size (name of the specimens), grains (mean), specimens, mean, within (of the mean, 95 %), scatter
    (standard deviation of one specimen), scatter_low, scatter_high (95 %, chi-squared).
    """
    rows = []
    for quantity in MEASURED:
        for size, group in ends.groupby("size", sort=False):
            found, scatter = cluster_mean(group[quantity]), group[quantity].std()
            shares = 0.5 * (1.0 + CONFIDENCE), 0.5 * (1.0 - CONFIDENCE)
            bounds = (scatter * math.sqrt((found.n - 1) / stats.chi2.ppf(share, found.n - 1)) for share in shares)
            mean = group["grains"].mean(), found.n, found.value, found.within
            rows.append((quantity, size, *mean, scatter, *bounds))
    columns = "quantity size grains specimens mean within scatter scatter_low scatter_high".split()
    table = pandas.DataFrame(rows, columns=columns)
    return table.sort_values(["quantity", "grains"], kind="stable", ignore_index=True)


def scatter_table(sizes: pandas.DataFrame) -> pandas.DataFrame:
    """The law scatter = c N^-exponent, a row per quantity, by maximum likelihood.

    The variance of n normal specimens is gamma distributed with (n - 1)/2 as its shape: a generalised linear model with
    a logarithmic link. Columns: quantity, exponent, low, high (95 %, from the likelihood ratio), p_value (that it is
    1/2), corrected (Holm), relative (scatter of a specimen of 1,000 grains divided by the mean, with the exponent 1/2),
    needed (number of grains for a relative scatter of 1 %).
    """
    rows = []
    for quantity, group in sizes[sizes["specimens"] > 1].groupby("quantity", sort=False):
        x, scatter = np.log(group["grains"].to_numpy() / SMALL), group["scatter"].to_numpy()
        typical = float(np.exp(np.log(scatter).mean()))
        variance = (scatter / typical) ** 2
        shape = 0.5 * (group["specimens"].to_numpy() - 1.0)

        def fit(design: np.ndarray, offset: np.ndarray, variance=variance, shape=shape) -> Any:
            family = Gamma(link=Log())
            return GLM(variance, design, family=family, offset=offset, var_weights=shape).fit(scale=1.0)

        best = fit(np.column_stack([np.ones_like(x), x]), np.zeros_like(x))

        def excess(exponent: float, x=x, fit=fit, best=best) -> float:  # excess over the best deviance, minus the limit
            return float(fit(np.ones((len(x), 1)), -2.0 * exponent * x).deviance - best.deviance - LIMIT)

        exponent = -0.5 * float(best.params[1])
        low, high = (optimize.brentq(excess, exponent, exponent + far) for far in (-FAR, FAR))
        small = typical * math.exp(0.5 * float(fit(np.ones((len(x), 1)), -x).params[0]))
        relative = small / abs(float(group["mean"].iloc[-1]))
        p_value, needed = stats.chi2.sf(excess(HALF) + LIMIT, 1), SMALL * (relative / ALLOWED) ** 2
        rows.append((quantity, exponent, low, high, p_value, relative, needed))
    table = pandas.DataFrame(rows, columns="quantity exponent low high p_value relative needed".split())
    table.insert(5, "corrected", adjusted(table["p_value"]))
    return table


def bias_table(ends: pandas.DataFrame) -> pandas.DataFrame:
    """Extrapolation to infinitely many grains: y = y_infinite + k N^-power, a row per quantity and power.

    Every specimen is weighted with its number of grains: its variance is proportional to 1/N. Columns: quantity, power,
    infinite, infinite_within, bias (of a specimen of 1,000 grains), within, relative (bias divided by infinite),
    specimens, p_value, corrected (Holm, all rows), judged (1 % of infinite), verdict.
    """
    rows = []
    for quantity in MEASURED:
        grains = ends["grains"].to_numpy(dtype=float)
        for name, power in BIAS.items():
            design = np.column_stack([np.ones_like(grains), (grains / SMALL) ** -power])
            fit = WLS(ends[quantity].to_numpy(dtype=float), design, weights=grains / grains.mean()).fit()
            found = [Tested.of(*one, fit.df_resid, len(ends)) for one in zip(fit.params, fit.bse, strict=True)]
            infinite, bias = found[0].value, found[1].value
            row = {"quantity": quantity, "power": name, "infinite": infinite, "infinite_within": found[0].within}
            row |= {"bias": bias, "within": found[1].within, "relative": bias / infinite, "specimens": len(ends)}
            rows.append(row | {"p_value": found[1].p_value, "judged": ALLOWED * abs(infinite)})
    return with_verdict(corrected(rows), "bias")


def c0_table(curves: pandas.DataFrame) -> pandas.DataFrame:
    """Error of C0, a row per size.

    Columns: size, grains (mean), specimens, norm (largest of a test, mean over the specimens), norm_within (95 %),
    norm_largest (of all tests), below (number of tests whose largest norm is below TOLERANCE), q (mean relative error
    of a test, mean over the specimens), q_within, q_scatter (standard deviation of one specimen).
    """
    known = curves[curves["c0_norm"].notna()]
    rows = []
    for size, group in known.groupby("size", sort=False):
        norms = group.groupby("run")["c0_norm"].max()
        qs = group[group["strain"] >= BEGIN].groupby("run")["c0_q"].mean()
        norm, q = cluster_mean(norms), cluster_mean(qs)
        row = {"size": size, "grains": group.groupby("run")["grains"].first().mean(), "specimens": len(norms)}
        row |= {"norm": norm.value, "norm_within": norm.within, "norm_largest": norms.max()}
        row |= {"below": int((norms < TOLERANCE).sum()), "q": q.value, "q_within": q.within, "q_scatter": qs.std()}
        rows.append(row)
    return pandas.DataFrame(rows)
