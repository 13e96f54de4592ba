"""A run as a calibration sees it: the strain it went through, and the five statistics that the model must follow."""

from __future__ import annotations

import dataclasses

import numpy as np
import xarray

from labkit.errors import InputError
from labkit.model.tensors import to_six

VARIABLES = (
    "coordination_number",
    "mean_normalised_force",
    "contact_anisotropy",
    "normal_force_anisotropy",
    "mobilisation",
)
MOST_RECORDS = 80  # of one run


@dataclasses.dataclass(frozen=True)
class Observation:
    """A run as a calibration sees it. `strain_step` (n-1, 6), `e` (n,), `values` (n, 5) as VARIABLES, zz components."""

    name: str
    path: str
    strain_step: np.ndarray
    e: np.ndarray
    values: np.ndarray


def observe(name: str, run: xarray.Dataset) -> Observation:
    """The Observation of a run opened with labkit.open_run. Raises InputError if it has nothing to fit.

    At most MOST_RECORDS records, evenly in travelled strain. e is the nominal void ratio, which C0 and the
    strain go with. Only the triaxial part of the tensors and of the strain is taken.
    """
    strain = triaxial(run["strain"].values)
    e = run["void_ratio_nominal"].values
    zz = [_zz(run[variable].values) if run[variable].ndim == 3 else run[variable].values for variable in VARIABLES]
    values = np.stack(zz, axis=1)
    good = np.isfinite(values).all(axis=1) & (values[:, 0] > 0.0)
    if not good.all():  # contacts were lost: what comes later has no A, F, F^t
        last = int(np.argmin(good))
        strain, e, values = strain[:last], e[:last], values[:last]
    if len(e) < 10:
        raise InputError(f"{name} has {len(e)} records with contacts: give a run with at least 10")
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(strain, axis=0), axis=(1, 2)))])
    if travelled[-1] == 0.0:
        raise InputError(f"{name} has no strain: a calibration needs runs that go somewhere, give another run")
    kept = np.unique(np.searchsorted(travelled, np.linspace(0.0, travelled[-1], min(MOST_RECORDS, len(e))) - 1e-15))
    kept = np.union1d(kept, _turns(strain[:, 2, 2]))  # a reversal belongs to the path
    return Observation(name, run.attrs["path"], to_six(np.diff(strain[kept], axis=0)), e[kept], values[kept])


def triaxial(tensor: np.ndarray) -> np.ndarray:
    """The part of a tensor (n, 3, 3) that is equal in x and y and has no shear, shape (n, 3, 3)."""
    radial = 0.5 * (tensor[:, 0, 0] + tensor[:, 1, 1])
    result = np.zeros_like(tensor)
    result[:, 0, 0], result[:, 1, 1], result[:, 2, 2] = radial, radial, tensor[:, 2, 2]
    return result


def _zz(tensor: np.ndarray) -> np.ndarray:
    """zz of the triaxial deviator."""
    return (2.0 * tensor[:, 2, 2] - tensor[:, 0, 0] - tensor[:, 1, 1]) / 3.0


def _turns(axial: np.ndarray) -> np.ndarray:
    """Numbers of the records (k,) at which the axial strain (n,) turns."""
    step = np.sign(np.diff(axial))
    return 1 + np.flatnonzero(step[1:] * step[:-1] < 0)
