"""Calibration from Z and A alone (section 5.4): Lambda and one equivalent anisotropy of the forces by inverting C0.

C0 has two equations in an axisymmetric test, for p and q, and three unknown force terms. With F^t = 0 they give Lambda
and an equivalent F, which holds the share of F^t in q as well.
"""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from analysis.model_evidence.increments import zz_component
from analysis.paper.ends import Runs
from analysis.paper.specimens import specimen_of
from analysis.statistics import cluster_mean
from labkit.model import Observation, observe

LEAST_PRESSURE = 50e3  # Pa
LEAST_RATIO = 0.2  # q/p above which F is compared


def inverted(
    p: np.ndarray, q: np.ndarray, e: np.ndarray, Z: np.ndarray, A: np.ndarray, E: float
) -> tuple[np.ndarray, np.ndarray]:
    """(Lambda, equivalent F_zz) from C0 with F^t = 0, for p and q in Pa, void ratio e, Z and A_zz, all (n,); E in Pa.

    With A = a diag(-1/2, -1/2, 1) and F likewise f, C0 gives q/S = (a + f)/5 + 2/35 a f and p/S = 1/3 + a f/15 with
    S = E Z Lambda/(1 + e).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = q / p
        F = (ratio / 3.0 - A / 5.0) / (1.0 / 5.0 + 2.0 / 35.0 * A - ratio * A / 15.0)
        Lam = p * (1.0 + e) / (E * Z * (1.0 / 3.0 + A * F / 15.0))
    return Lam, F


def observe_inverted(name: str, run: xr.Dataset) -> Observation:
    """The Observation of a run (labkit.model.observe) with Lambda and F inverted from its stress, and F^t = 0."""
    Lam, F = _of_run(run)
    tensor = F[:, None, None] * np.diag([-0.5, -0.5, 1.0])
    tensors = {"normal_force_anisotropy": tensor, "mobilisation": 0.0 * tensor}
    known: dict[str, object] = {name: (("time", "i", "j"), values) for name, values in tensors.items()}
    return observe(name, run.assign(known | {"mean_normalised_force": ("time", Lam)}))


def inversion_errors(runs: Runs) -> pandas.DataFrame:
    """Test how well Lambda and F follow from the stress, e, Z and A; a pandas.DataFrame with a row per quantity.

    The error of Lambda is relative, that of F is the inverted minus the measured F_zz, and that of F + 7.5 F^t the
    inverted F minus F_zz + 15/2 F^t_zz, the combination that C0 contains. `mean` and `within` are over specimens (95
    %), `rms` is the mean over tests. Only records with p > 50 kPa, and q/p > 0.2 for F, are used.
    """
    rows = []
    for name, run in runs.items():
        p, q = run.lab.mean_stress().values, run.lab.deviatoric_stress().values
        Lam, F = _of_run(run)
        own_F = run["normal_force_anisotropy"].values[:, 2, 2]
        both = own_F + 7.5 * run["mobilisation"].values[:, 2, 2]
        judged = (p > LEAST_PRESSURE) & np.isfinite(Lam) & np.isfinite(own_F)
        sheared = judged & (q > LEAST_RATIO * p)
        for quantity, error, kept in (
            ("Lambda", Lam / run["mean_normalised_force"].values - 1.0, judged),
            ("F", F - own_F, sheared),
            ("F + 7.5 F^t", F - both, sheared),
        ):
            if kept.any():
                values = error[kept]
                rows.append((specimen_of(name), quantity, values.mean(), float(np.sqrt(np.mean(values**2)))))
    table = pandas.DataFrame(rows, columns=["specimen", "quantity", "mean", "rms"])
    summary = []
    for quantity, group in table.groupby("quantity", sort=False):
        found = cluster_mean(group["mean"], group["specimen"])
        summary.append((quantity, len(group), found.n, found.value, found.within, group["rms"].mean()))
    return pandas.DataFrame(summary, columns=["quantity", "tests", "specimens", "mean", "within", "rms"])


def _of_run(run: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    A = zz_component(run["contact_anisotropy"].values.astype(float))
    e, Z = (run[name].values.astype(float) for name in ("void_ratio_nominal", "coordination_number"))
    p, q = (stress.values.astype(float) for stress in (run.lab.mean_stress(), run.lab.deviatoric_stress()))
    return inverted(p, q, e, Z, A, run.lab.scene.young_modulus)
