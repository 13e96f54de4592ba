"""Selects steps of a path file from a run, as if the run had consisted of these steps alone."""

from __future__ import annotations

import json
import re

import numpy as np
import xarray

from labkit.errors import InputError
from labkit.paths.path import Path
from labkit.paths.steps import Steps
from labkit.results.selections import find_records

RANGE = re.compile(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?")


def records_of_steps(
    run: xarray.Dataset, path: Path | None, reference: np.ndarray | None, step: int | str
) -> xarray.Dataset:
    """Return the records and snapshots of some steps; the first record is the last one of the step before.

    The path of the result has these steps only, counted from 1. Strains keep their values, and the accumulated strain
    begins at 0. Raises InputError for a run without these steps.

    Args:
        run: Run opened with labkit.open_run.
        path: Path of the run.
        reference: Stress at the start of undrained loading (labkit.quantities.scalars.Facts.reference).
        step: Number of the step, from 1, or the first and the last of several, `4-18`.
    """
    if not isinstance(path, Steps):
        raise InputError(f"is for path files, not for a run of {run.attrs['path']}: leave it out", field="step")
    number, named = run["path_step"].values, RANGE.fullmatch(str(step))
    first, last = (0, 0) if named is None else (int(named[1]), int(named[2] or named[1]))
    most = int(number[-1])
    if not 1 <= first <= last <= most:
        allowed = f"1 to {most}, or a range such as 1-{most}"
        raise InputError("is not a step of this run", field="step", value=step, allowed=allowed)
    at = np.flatnonzero((number >= first) & (number <= last))
    begin, end = max(int(at[0]) - 1, 0), int(at[-1]) + 1
    record = find_records(run)
    snapshots = np.flatnonzero((record >= begin) & (record < end))
    part = run.isel(time=slice(begin, end), snapshot=snapshots)
    parameters = json.loads(run.attrs["path_parameters"])
    parameters["steps"] = [parameters["steps"][which] for which in path.order[first - 1 : last]]
    before = np.zeros(9) if reference is None else np.broadcast_to(reference, (len(number), 3, 3))[at[0]].ravel()
    earlier = part["path_step"] < first
    return part.assign(
        record=part["record"].copy(data=record[snapshots] - begin),
        path_step=part["path_step"].where(~earlier, first) - (first - 1.0),
        path_step_progress=part["path_step_progress"].where(~earlier, 0.0),
    ).assign_attrs(
        path_parameters=json.dumps(parameters | {"order": []}),
        undrained_before=np.nan_to_num(before),
        shown_steps=f"step {first}" if first == last else f"steps {first} to {last}",
    )
