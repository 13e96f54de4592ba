"""Constants of anisotropic critical state theory from the grains: A over its critical value is its fabric tensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas
import xarray as xr
from scipy.optimize import least_squares

from analysis.curves import each_run
from analysis.model_benchmark.attractors import LAST
from analysis.model_benchmark.score import increments_of
from analysis.statistics import jackknife
from labkit.micro import deviator, mean_stress

CONSTANT_P = ("cp", "true_triaxial")  # paths
RATES = (1.0, 1e3)  # bounds of k_F
SOFT = 0.1  # error of D beyond which an outlier counts less


def fabric_constants(tests: xr.Dataset) -> pandas.DataFrame:
    """k_F and e_A of analysis.peers.acst from A, e and stress of tests: constant, of, value, within, packings.

    `of` is `all packings`, or for k_F also each packing, whose `within` is NaN.
    """
    paths = [_followed(one) for _, one in each_run(tests)]
    packings = list(map(str, tests["packing"].values))
    found = jackknife(lambda rows: _k_F([paths[k] for k in rows]), len(paths), 1, packings)
    rows: list[tuple[str, str, float, float, int]] = [("k_F", "all packings", found.value, found.within, found.n)]
    for name in dict.fromkeys(packings):
        own = [path for path, packing in zip(paths, packings, strict=True) if packing == name]
        rows.append(("k_F", name, _k_F(own), np.nan, 1))
    drained = [k for k, path in enumerate(tests["path"].values) if path in CONSTANT_P]
    points = [_dilatancy(tests.isel(run=k)) for k in drained]
    of_drained = [packings[k] for k in drained]
    found = jackknife(lambda rows: _e_A(np.hstack([points[k] for k in rows])), len(points), 3, of_drained)
    rows.append(("e_A", "all packings", found.value, found.within, found.n))
    return pandas.DataFrame(rows, columns=["constant", "of", "value", "within", "packings"])


def _followed(test: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions (m, 3, 3) and norms (m,) of the deviatoric strain increments, and A over its norm at the end."""
    steps = deviator(increments_of(test))
    sizes = np.linalg.norm(steps, axis=(1, 2))
    A = deviator(test["A"].values)
    kept = sizes > 0.0
    A_end = np.linalg.norm(A[_last(test)].mean(axis=0))
    return steps[kept] / sizes[kept, None, None], sizes[kept], A[np.concatenate([[True], kept])] / A_end


def _last(test: xr.Dataset) -> np.ndarray:
    along = test["along"].values
    return along >= LAST * along[-1]


def _k_F(paths: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """The k_F whose dF = k_F (n - F) |d dev strain| is closest to the fabric of the tests."""

    def off(x: np.ndarray) -> np.ndarray:
        rows = []
        for n, sizes, own in paths:
            F = [own[0]]
            for direction, left in zip(n, np.exp(-np.exp(x[0]) * sizes), strict=True):
                F.append(left * F[-1] + (1.0 - left) * direction)
            rows.append((np.array(F) - own).ravel())
        return np.concatenate(rows)

    return float(np.exp(least_squares(off, [np.log(20.0)], bounds=np.log(RATES)).x[0]))


def _dilatancy(test: xr.Dataset) -> np.ndarray:
    """D, psi, A:n/|A_end| and R/R_end between the points of a test at constant p, (4, m)."""
    n, sizes, A = _followed(test)
    stress, e, last = test["stress"].values, test["e"].values, _last(test)
    R = np.linalg.norm(deviator(stress), axis=(1, 2)) / mean_stress(stress)
    R, psi, A = (0.5 * (v[1:] + v[:-1]) for v in (R / R[last].mean(), e - e[last].mean(), A))
    D = -np.diff(np.log1p(e)) / (np.sqrt(2.0 / 3.0) * sizes)
    return np.stack([D, psi, np.einsum("kij,kij->k", A, n), R])


def _e_A(points: np.ndarray) -> float:
    """e_A of D = d0 [exp(m (psi - e_A (A - 1))) - R] by least squares for d0, m and e_A."""
    D, psi, A, R = points

    def off(x: np.ndarray) -> np.ndarray:
        return x[0] * (np.exp(np.clip(x[1] * (psi - x[2] * (A - 1.0)), -20.0, 20.0)) - R) - D

    return float(least_squares(off, [0.7, 4.0, 0.1], loss="soft_l1", f_scale=SOFT).x[2])
