"""The records of the snapshots of a run, also after a selection of records such as `run.isel(time=...)`."""

from __future__ import annotations

import numpy as np
import xarray

from labkit.errors import InputError


def find_records(run: xarray.Dataset) -> np.ndarray:
    """Return the index along `time` of the record of each snapshot, -1 where a selection of records lacks it.

    The stored `record` counts all records of the file; times, or axial strains without times, identify them.
    """
    by_time = "snapshot_time" in run.variables
    values = run["time" if by_time else "axial_strain"].values.tolist() if "time" in run.dims else []
    first = {value: k for k, value in reversed([*enumerate(values)])}
    stored, wanted = run["record"].values, run["snapshot_time" if by_time else "snapshot_strain"].values
    pairs = zip(stored.tolist(), wanted.tolist(), strict=True)
    return np.array([k if values[k : k + 1] == [value] else first.get(value, -1) for k, value in pairs], dtype=int)


def require_records(run: xarray.Dataset) -> np.ndarray:
    """Return the index along `time` of each snapshot's record, (snapshot,). Raises InputError if one is missing."""
    records = find_records(run)
    if (missing := np.flatnonzero(records < 0)).size:
        holds = [int(k) for k in np.flatnonzero(records >= 0)]
        problem = f"this selection of records lacks those of snapshots {', '.join(map(str, missing))}"
        raise InputError(f"{problem}: select the other snapshots too, run.isel(time=..., snapshot={holds})")
    return records
