"""The output file of the Incremental Driver: time, strain, stress and state variables, one row for each record.

The state variables are e, Z, Lambda, A, F and F^t, 21 numbers; tensors have the driver's order of components and keep
labkit's sign (compression positive).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray

from labkit.micro.tensors import symmetric
from labkit.paths.programme import PROGRESS
from labkit.paths.steps import Steps
from labkit.plugins.incremental.conventions import STRESS_UNITS, components

STATE = ("void_ratio_nominal", "coordination_number", "mean_normalised_force")
TENSORS = ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
VARIABLES = 21
NAMES = (
    "time(1)",
    "time(2)",
    *(f"stran({k})" for k in range(1, 7)),
    *(f"stress({k})" for k in range(1, 7)),
    *(f"statev({k})" for k in range(1, VARIABLES + 1)),
)


def columns(run: xarray.Dataset, path: Steps, stress_unit: str = "kPa") -> np.ndarray:
    """Return the rows of the output file, (n, 35).

    Args:
        run: Run along `path`, opened with labkit.open_run.
        path: Path of the test.
        stress_unit: Unit of stresses in the output, Pa, kPa or MPa.
    """
    time = elapsed_time({name: run[name].values for name in PROGRESS}, path)
    strain = components(symmetric(run["strain"].values), shear=0.5)
    stress = components(symmetric(run["stress"].values)) / STRESS_UNITS[stress_unit]
    state = [run[name].values for name in STATE]
    tensors = [-components(symmetric(run[name].values)) for name in TENSORS]
    return np.column_stack([time, time, strain, stress, *state, *tensors])


def elapsed_time(progress: Mapping[str, np.ndarray], path: Steps) -> np.ndarray:
    """Return the time of the test at each record, (n,), s, from the durations of the steps in the test file.

    For a step that ended early, only the time of the completed part counts. `progress` holds the variables PROGRESS of
    the run.
    """
    number, share = (np.asarray(progress[name]) for name in PROGRESS)
    time, before = np.zeros(len(number)), 0.0
    for leg in range(len(path.order)):
        at = np.flatnonzero(number == leg + 1)
        if len(at):
            durations = path.steps[path.order[leg]].durations or (0.0,)
            ends = np.concatenate([[0.0], np.cumsum(durations)])
            time[at] = before + np.interp(share[at] * len(durations), np.arange(len(ends)), ends)
            before = time[at[-1]]
    return time


def output_text(rows: np.ndarray, heading: str = "") -> str:
    """Return the text of the output file: the names of the columns, the heading, if any, and the rows."""
    lines = ["".join(f"{name:>20}" for name in NAMES)]
    lines += [heading] if heading else []
    rows = np.where(np.abs(rows) < 1e-99, 0.0, rows)
    lines += ["".join(f"{value:20.10E}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
