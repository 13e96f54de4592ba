"""Calibration data of a run: its strain, and the five statistics that the model must reproduce."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import xarray

from labkit.errors import InputError
from labkit.micro.tensors import to_six
from labkit.results.endings import LABORATORY

VARIABLES = (
    "coordination_number",
    "mean_normalised_force",
    "contact_anisotropy",
    "normal_force_anisotropy",
    "mobilisation",
)
MOST_RECORDS = 80  # largest number of records used from one run, apart from reversals


@dataclasses.dataclass(frozen=True, eq=False)
class Observation:
    """Calibration data of a run: `strain_step` (n-1, 6), `e` (n,), and `values` (n, 5) of VARIABLES, zz components.

    `young_modulus` is that of the grains, Pa, by which Lambda is normalised.
    """

    name: str
    path: str
    strain_step: np.ndarray
    e: np.ndarray
    values: np.ndarray
    young_modulus: float


def observe(name: str, run: xarray.Dataset) -> Observation:
    """Return the Observation of a run opened with labkit.open_run.

    At most MOST_RECORDS records, evenly spaced in accumulated strain, and every reversal are used. e is the nominal
    void ratio, which C0 uses and which is consistent with the strain. Only the triaxial part of the tensors and of the
    strain is used.
    Raises InputError for a run with fewer than 10 records with contacts, or without strain.
    """
    strain = triaxial(run["strain"].values)
    e = run["void_ratio_nominal"].values
    zz = [_zz(run[variable].values) if run[variable].ndim == 3 else run[variable].values for variable in VARIABLES]
    values = np.stack(zz, axis=1)
    good = np.isfinite(values).all(axis=1) & (values[:, 0] > 0.0)
    if not good.all():  # the contacts were lost: A, F and F^t are undefined from that point on
        last = int(np.argmin(good))
        strain, e, values = strain[:last], e[:last], values[:last]
    if len(e) < 10:
        raise InputError(f"{name} has {len(e)} records with contacts: give a run with at least 10")
    accumulated_strain = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(strain, axis=0), axis=(1, 2)))])
    if accumulated_strain[-1] == 0.0:
        raise InputError(
            f"the specimen in {name} was not strained: calibration needs runs with strain; give another run"
        )
    records = np.unique(
        np.searchsorted(accumulated_strain, np.linspace(0.0, accumulated_strain[-1], min(MOST_RECORDS, len(e))) - 1e-15)
    )
    records = np.union1d(records, _turns(strain[:, 2, 2]))  # always include reversals: they define the path
    step, modulus = to_six(np.diff(strain[records], axis=0)), run.lab.scene.young_modulus
    return Observation(name, run.attrs["path"], step, e[records], values[records], modulus)


def require_usable(runs: Mapping[str, xarray.Dataset]) -> tuple[dict[str, xarray.Dataset], dict[str, str]]:
    """Select the runs that a calibration may use; returns (name -> run, name -> reason for leaving a run out).

    Predictions of the model, measured tests, unfinished runs and runs that are not axisymmetric are left out. Raises
    InputError if no run is left.
    """
    left_out = {}
    for name, run in runs.items():
        if run.attrs.get("engine") == "model":
            left_out[name] = "prediction of the model, not a simulation"
        elif run.attrs.get("engine") == LABORATORY:
            left_out[name] = "measured in a laboratory, without contacts"
        elif not run.attrs.get("complete", 1):
            left_out[name] = "unfinished"
        elif not run.lab.axisymmetric:
            left_out[name] = f"path {run.attrs['path']} is not axisymmetric"
    if runs and len(left_out) == len(runs):
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(f"none of these runs can be used in a calibration: give complete simulations ({reasons})")
    return {name: run for name, run in runs.items() if name not in left_out}, left_out


def triaxial(tensor: np.ndarray) -> np.ndarray:
    """Return the triaxial part of tensors (n, 3, 3): equal in x and y, and without shear; shape (n, 3, 3)."""
    radial = 0.5 * (tensor[:, 0, 0] + tensor[:, 1, 1])
    result = np.zeros_like(tensor)
    result[:, 0, 0], result[:, 1, 1], result[:, 2, 2] = radial, radial, tensor[:, 2, 2]
    return result


def _zz(tensor: np.ndarray) -> np.ndarray:
    """Return the zz component of the triaxial deviator."""
    return (2.0 * tensor[:, 2, 2] - tensor[:, 0, 0] - tensor[:, 1, 1]) / 3.0


def _turns(axial: np.ndarray) -> np.ndarray:
    """Return the indices (k,) of the records at which the axial strain (n,) reverses."""
    step = np.sign(np.diff(axial))
    return 1 + np.flatnonzero(step[1:] * step[:-1] < 0)
