"""The critical state: where shear tests end up, and how much they scatter there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas
import xarray

from labkit.dem.paths import PATHS

WINDOW = 0.25  # the last quarter of the strain of a test


SHEAR = ("cv", "cr", "cp")  # the paper's shear tests


def is_shear(run: xarray.Dataset) -> bool:
    """Whether the path of a run ends, if long enough, in a critical state; False for a path unknown here."""
    return run.attrs["path"] in PATHS and PATHS[run.attrs["path"]].shear


def at_end(axial_strain: np.ndarray, window: float = WINDOW) -> np.ndarray:
    """Which records count as critical: those of the last quarter of the strain, shape (time,) of bool.

    `axial_strain` (time,) of a test in compression or extension; `window`: another share than the last quarter.
    """
    return np.abs(axial_strain) >= (1.0 - window) * np.abs(axial_strain[-1])


def critical_states(runs: Mapping[str, xarray.Dataset], window: float = WINDOW) -> pandas.DataFrame:
    """A pandas.DataFrame with a row per shear test: means over the last quarter of the strain, and the scatter of M.

    `runs`: name -> run of SHEAR opened with labkit.open_run. M = q/p; its scatter is the standard deviation of the
    records. `window`: another share of the strain than the last quarter.
    """
    rows = []
    for name, run in runs.items():
        strain = run["axial_strain"].values
        last = at_end(strain, window)
        ratio = (run.lab.deviatoric_stress() / run.lab.mean_stress()).values[last]
        mean = {key: float(run[key].values[last].mean()) for key in ("void_ratio", "coordination_number")}
        zz = {key: float(run[key].values[last, 2, 2].mean()) for key in TENSORS}
        rows.append(
            {
                "run": name,
                "path": run.attrs["path"],
                "strain": float(strain[-1]),
                "M": float(np.mean(ratio)),
                "M_scatter": float(np.std(ratio)),
                "p_MPa": float(run.lab.mean_stress().values[last].mean() / 1e6),
                "e": mean["void_ratio"],
                "Z": mean["coordination_number"],
                "Lambda": float(run["mean_normalised_force"].values[last].mean()),
                **{label: zz[key] for key, label in TENSORS.items()},
            }
        )
    return pandas.DataFrame(rows)


TENSORS = {"contact_anisotropy": "A_zz", "normal_force_anisotropy": "F_zz", "mobilisation": "Ft_zz"}
