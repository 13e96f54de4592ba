"""Do all groups of tests lie on one line? A likelihood-ratio test in which tests of one specimen may share an offset.

The model is y = X b + G g + u + r: X the line (for a nonlinear line, its Jacobian at the fit), G the groups or a
covariate, u a random offset of each specimen, r the scatter of single tests (a linear mixed model, as statsmodels'
MixedLM). If no specimen was tested twice, u cannot be told from r and the F test of least squares is exact. Otherwise
the reference distribution of the likelihood ratio is simulated (parametric bootstrap), because its asymptotic one
rejects too often with few specimens.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pandas
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics import student

OFFSETS = ["group", "tests", "specimens", "offset", "within"]
DRAWS = 1999  # draws of the simulated reference distribution
RATIOS = np.concatenate([[0.0], np.geomspace(0.05, 50.0, 24)])  # ratios of the variance of u to that of r


@dataclasses.dataclass(frozen=True)
class OneLine:
    """Result of `one_line`.

    Args:
        statistic: F, or the likelihood ratio 2 (log L1 - log L0) if specimens were tested more than once.
        p_value: p-value of the hypothesis that no group is off the line.
        scatter: Standard deviation of a test around the line, including the scatter of specimens.
        shared: Part of that variance which the tests of one specimen share.
        offsets: A pandas.DataFrame with a row per group (or one row, `slope`, for a covariate) with the columns group,
            tests, specimens, offset (of the group from all others) and within (95 % half-width).
    """

    statistic: float
    p_value: float
    scatter: float
    shared: float
    offsets: pandas.DataFrame


def one_line(
    values: ArrayLike, line: ArrayLike, factor: ArrayLike, clusters: ArrayLike | None = None, draws: int = DRAWS
) -> OneLine:
    """Test that the offsets of all groups from a line are zero.

    All results are NaN for too few tests or a single group.

    Args:
        values: The quantity of each test, or its residual from a nonlinear fit, (n,).
        line: Columns of the line, e.g. [1, e] or, for a nonlinear line, its Jacobian at the fit, (n, k).
        factor: Labels of groups (text), or values of a covariate such as the Lode angle, (n,).
        clusters: Specimens of the tests (default: every test has its own), (n,).
        draws: Size of the simulated reference distribution.
    """
    y, columns = np.asarray(values, dtype=float), _independent(np.asarray(line, dtype=float))
    specimen = np.arange(len(y)) if clusters is None else pandas.factorize(np.asarray(clusters))[0]
    names, members = _groups(np.asarray(factor))
    full = _independent(np.hstack([columns, members]))
    added = full.shape[1] - columns.shape[1]
    count = len(np.unique(specimen))
    if added < 1 or min(len(y), count) <= full.shape[1]:
        return OneLine(math.nan, math.nan, math.nan, math.nan, pandas.DataFrame(columns=OFFSETS))
    if count == len(y):  # each specimen was tested once, so use the F test
        one, apart = (float(np.sum((y - basis @ (basis.T @ y)) ** 2)) for basis in (columns, full))
        freedom = len(y) - full.shape[1]
        statistic = (one - apart) / added / (apart / freedom)
        p_value = float(stats.f.sf(statistic, added, freedom))
        deviation, share = math.sqrt(one / (len(y) - columns.shape[1])), 0.0
        covariance = np.eye(len(y))
    else:
        same = specimen[:, None] == specimen[None, :]
        null, other = MixedModel(columns, same), MixedModel(full, same)
        statistic = float(2.0 * (other.likelihood(y[:, None]) - null.likelihood(y[:, None]))[0])
        deviation, share = null.scatter(y)
        drawn = np.linalg.cholesky(_covariance(share, same)) @ np.random.default_rng(1).normal(size=(len(y), draws))
        simulated = 2.0 * (other.likelihood(drawn) - null.likelihood(drawn))
        p_value = float((1.0 + np.sum(simulated >= statistic)) / (1.0 + draws))
        covariance = _covariance(other.scatter(y)[1], same)  # what the tests of a specimen share besides their group
    offsets = _offsets(y, columns, names, members, specimen, covariance)
    return OneLine(statistic, p_value, deviation, share, offsets)


def _covariance(share: float, same: np.ndarray) -> np.ndarray:
    """Covariance of the tests over their variance, of which those of one specimen share a part (n, n)."""
    return (1.0 - share) * np.eye(len(same)) + share * same


def _groups(factor: np.ndarray) -> tuple[list[str], np.ndarray]:
    """(names of the groups, their columns (n, groups)); a covariate is one centred column called `slope`."""
    if np.issubdtype(factor.dtype, np.number):
        return ["slope"], (factor - factor.sum() / max(len(factor), 1))[:, None].astype(float)
    codes, names = pandas.factorize(factor.astype(str))
    return [str(name) for name in names], (codes[:, None] == np.arange(len(names))).astype(float)


def _independent(columns: np.ndarray) -> np.ndarray:
    """An orthonormal basis of the space of the columns (n, rank)."""
    size = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return left[:, singular > 1e-9 * singular.max(initial=0.0)]


class MixedModel:
    """Likelihood of a linear mixed model with one random offset per specimen, maximised over RATIOS."""

    def __init__(self, columns: np.ndarray, same: np.ndarray) -> None:
        n = len(same)
        self.n = n
        self.residual, self.log_determinant = [], []
        for ratio in RATIOS:
            factor = np.linalg.cholesky(np.eye(n) + ratio * same)
            whitened = np.linalg.solve(factor, columns)
            basis = np.linalg.qr(whitened)[0]
            inverse = np.linalg.inv(factor)
            self.residual.append(inverse - basis @ (basis.T @ inverse))
            self.log_determinant.append(2.0 * float(np.log(np.diag(factor)).sum()))

    def each(self, y: np.ndarray) -> np.ndarray:
        """Log-likelihood up to a constant of each column of y (n, m) at each ratio (ratios, m)."""
        squares = np.array([np.sum((residual @ y) ** 2, axis=0) for residual in self.residual])
        return -0.5 * (self.n * np.log(squares) + np.array(self.log_determinant)[:, None])

    def likelihood(self, y: np.ndarray) -> np.ndarray:
        """Largest log-likelihood up to a constant of each column of y (n, m), shape (m,)."""
        return self.each(y).max(axis=0)

    def scatter(self, y: np.ndarray) -> tuple[float, float]:
        """(standard deviation of a test around the line, part of its variance shared by tests of one specimen)."""
        best = int(self.each(y[:, None])[:, 0].argmax())
        residual = self.residual[best]
        freedom = int(np.linalg.matrix_rank(residual))
        own = float(np.sum((residual @ y) ** 2)) / freedom
        return math.sqrt(own * (1.0 + RATIOS[best])), float(RATIOS[best] / (1.0 + RATIOS[best]))


def _offsets(
    y: np.ndarray,
    columns: np.ndarray,
    names: list[str],
    members: np.ndarray,
    specimen: np.ndarray,
    covariance: np.ndarray,
) -> pandas.DataFrame:
    """Offset of each group from all others by generalised least squares; degrees of freedom count specimens."""
    inverse = np.linalg.inv(np.linalg.cholesky(covariance))
    line, target = inverse @ columns, inverse @ y
    basis = np.linalg.qr(line)[0]
    rows = []
    for name, member in zip(names, members.T, strict=True):
        own = inverse @ member
        own = own - basis @ (basis.T @ own)
        rest = target - basis @ (basis.T @ target)
        size = float(own @ own)
        inside = member != 0.0
        found = math.nan, math.nan
        if size > 1e-12 * float(member @ member):
            offset = float(own @ rest) / size
            squares = float(np.sum((rest - offset * own) ** 2)) / (len(y) - columns.shape[1] - 1)
            freedom = len(np.unique(specimen)) - columns.shape[1] - 1
            found = offset, student(math.sqrt(squares / size), freedom)
        rows.append((name, int(inside.sum()), len(np.unique(specimen[inside])), *found))
    return pandas.DataFrame(rows, columns=OFFSETS)
