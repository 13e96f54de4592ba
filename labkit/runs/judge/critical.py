"""Critical state of shear tests: means over the last part of each test, and their scatter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas
import xarray

from labkit.errors import InputError
from labkit.paths.registry import PATHS
from labkit.runs.read.dataset import datasets_of

WINDOW = 0.25  # fraction of the strain of a test: its last quarter
ENOUGH_STRAIN = 0.15  # least strain at which the end of a shear test is treated as critical
COMPRESSION = "triaxial compression"
SHEAR = ("cv", "cr", "cp")  # the shear tests of the paper
SCALARS = {"void_ratio": "e", "coordination_number": "Z", "mean_normalised_force": "Lambda"}
TENSORS = {"contact_anisotropy": "A_zz", "normal_force_anisotropy": "F_zz", "mobilisation": "Ft_zz"}


def is_shear(run: xarray.Dataset) -> bool:
    """Return True if the path of the run leads to a critical state; False for a path that is not registered here."""
    return run.attrs["path"] in PATHS and PATHS[run.attrs["path"]].shear


def why_not_critical(run: xarray.Dataset, least_strain: float = ENOUGH_STRAIN) -> str | None:
    """Return why the end of a run is not critical; None for a complete shear test to a sufficient strain.

    The strain is gamma_xz in simple shear, otherwise the axial strain. `run`: opened with labkit.open_run.
    """
    strain = run.lab.strain()
    reached, which = abs(float(strain[-1])), strain.attrs["long_name"]
    if not is_shear(run):
        return f"path {run.attrs['path']} is not a shear test"
    if not run.attrs["complete"]:
        return f"unfinished, stopped at {reached:.2%} {which}"
    if reached < least_strain * (1.0 - 1e-6):  # some files store strains in single precision
        return f"ends at {reached:.2%} {which}, before {least_strain:.3g}"
    return None


def require_critical(
    runs: Mapping[str, xarray.Dataset], least_strain: float = ENOUGH_STRAIN
) -> tuple[dict[str, xarray.Dataset], dict[str, str]]:
    """Select the runs that end in a critical state; returns (name -> run, name -> reason why a run is left out).

    A run is left out if its end is not critical (`why_not_critical`). Predictions of the model are also left out if
    other runs are simulations. `runs`: name -> run opened with labkit.open_run. Raises InputError if no run is left.
    """
    left_out = {name: reason for name, run in runs.items() if (reason := why_not_critical(run, least_strain))}
    kept = {name: run for name, run in runs.items() if name not in left_out}
    if any(run.attrs.get("engine") != "model" for run in kept.values()):
        predicted = [name for name, run in kept.items() if run.attrs.get("engine") == "model"]
        left_out |= dict.fromkeys(predicted, "prediction of the model, not a simulation")
    kept = {name: run for name, run in kept.items() if name not in left_out}
    if not kept:
        shear = any(is_shear(run) for run in runs.values())
        problem = "none of these runs reaches a critical state" if shear else "none of these runs is a shear test"
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(f"{problem}: give complete runs of cv, cr, cp or another shear path ({reasons})")
    return kept, left_out


def at_end(strain: np.ndarray, window: float = WINDOW) -> np.ndarray:
    """Select the records treated as critical, in the last quarter of the strain; shape (time,) of bool.

    Args:
        strain: Strain of a test in compression, extension or shear, (time,).
        window: Fraction of the strain to use instead of the last quarter.
    """
    return np.abs(strain) >= (1.0 - window) * np.abs(strain[-1])


def mean_strengths(runs: Mapping[str, xarray.Dataset], states: pandas.DataFrame) -> list[str]:
    """Report the mean M in compression, in extension and on each path that is not triaxial, one line each.

    For the paper's soil, the lines also give the paper's M. `states`: the table `critical_states` of these runs.
    """
    kinds = [_kind(run) for run in runs.values()]
    lines = []
    paper = " (paper: 0.92)" if all(run.lab.scene.of_the_paper for run in runs.values()) else ""
    for kind in dict.fromkeys(kinds):
        M = states["M"][[each == kind for each in kinds]]
        which = "all runs" if len(set(kinds)) == 1 else f"the runs of {kind}"
        scatter = f" +- {M.std():.3f} between tests" if len(M) > 1 else ""
        lines.append(f"mean M of {which}: {M.mean():.3f}{scatter}" + paper * (kind == COMPRESSION))
    return lines


def _kind(run: xarray.Dataset) -> str:
    if not run.lab.axisymmetric:
        return str(run.attrs["path"])
    return COMPRESSION if float(run["axial_strain"][-1]) > 0.0 else "triaxial extension"


def critical_states(runs: Mapping[str, xarray.Dataset], window: float = WINDOW) -> pandas.DataFrame:
    """Return a table with a row per shear test: means over the last quarter of the strain, and the scatter of M.

    M = q/p; its scatter is the standard deviation over the records. If a test is not axisymmetric, q is the invariant
    sqrt(3/2 s:s), and A_zz, F_zz and Ft_zz are the components along the stress deviator s, which equal the zz
    components in triaxial compression. All runs are used; `require_critical` selects runs with a critical state.

    Args:
        runs: Name -> labkit.Run, or Dataset of labkit.open_run.
        window: Fraction of the strain to use instead of the last quarter.
    """
    rows = []
    for name, run in datasets_of(runs).items():
        strain = run.lab.strain().values
        last = at_end(strain, window)
        ratio = run.lab.stress_ratio().values[last]
        mean = {label: float(run[key].values[last].mean()) for key, label in SCALARS.items()}
        zz = {label: float(run.lab.component(key).values[last].mean()) for key, label in TENSORS.items()}
        rows.append(
            {
                "run": name,
                "path": run.attrs["path"],
                "strain": float(strain[-1]),
                "M": float(np.mean(ratio)),
                "M_scatter": float(np.std(ratio)),
                "p_MPa": float(run.lab.mean_stress().values[last].mean() / 1e6),
                **mean,
                **zz,
            }
        )
    return pandas.DataFrame(rows)
