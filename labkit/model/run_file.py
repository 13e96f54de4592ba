"""Writes a Result of the model as a run file with the variables of a simulation, so that the same code reads both.

Quantities that have no meaning without grains are NaN (inertial number, overlap, rattlers, kinetic energy, unbalanced
force, drift); the groups `contacts` and `grains` are present but empty. Both stresses are computed from C0, and both
void ratios are the e of the model. The cell is a cube of 1 m at zero strain. The attribute `engine` is `model`.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import labkit
import labkit.runs.dataset  # registers the accessor .lab for as_run
from labkit.errors import InputError
from labkit.grains.scene import Scene
from labkit.io.conventions import describe
from labkit.io.netcdf import create_variables, new_netcdf
from labkit.io.provenance import has_changed, provenance_json
from labkit.io.schema import CONTACTS, GRAINS, RECORD, Variable
from labkit.model.driver import Result, variables_of
from labkit.model.parameters import Model
from labkit.paths.programme import PROGRESS
from labkit.paths.rates import rate_of
from labkit.runs.dataset import with_axes

MODEL_ENGINE = "model"


def records_of_result(result: Result) -> dict[str, np.ndarray]:
    """Return the variables of labkit.io.schema.RECORD and of Path.recorded for a Result, name -> array along time."""
    principal, direction = np.linalg.eigh(result.strain)
    cell = (direction * np.exp(-principal)[:, None, :]) @ np.swapaxes(direction, 1, 2)
    known = {
        "time": result.travelled / rate_of(result.path),
        **variables_of(result.vector, result.stress),
        "stress_sff": result.stress,
        "cell": cell,
        "volume": np.linalg.det(cell),
    }
    size = {"time": len(result), "i": 3}
    absent = {
        name: np.full([size[d] for d in variable.dimensions], np.nan)
        for name, variable in RECORD.items()
        if name not in known
    }
    return {**known, **absent, **result.progress}


def as_run(result: Result) -> xr.Dataset:
    """Return the Dataset that labkit.open_run would return for the run file of a Result, without writing a file."""
    values = records_of_result(result)
    variables = {
        name: (v.dimensions, values[name], {"units": v.units, "long_name": v.long_name})
        for name, v in _variables(result).items()
    }
    return with_axes(xr.Dataset(variables, attrs=_attributes(result, {})).set_coords(["time", "axial_strain"]))


def _variables(result: Result) -> dict[str, Variable]:
    """The variables of a run file of this Result."""
    return {**RECORD, **(PROGRESS if result.path.phases else {})}


def _attributes(result: Result, parameters: Mapping[str, object]) -> dict[str, Any]:
    """Return attributes that identify the test, by its path and `parameters`, and that say how it ended."""
    return {
        "engine": MODEL_ENGINE,
        "path": result.path.name,
        "path_parameters": json.dumps({**dataclasses.asdict(result.path), **parameters}),
        "complete": np.int32(result.failure is None),
        "model": result.model.to_json(),
        "ended_because": result.failure or result.ended_because,
    }


def write_result(
    file: str | os.PathLike[str],
    result: Result,
    history: str = "",
    wall_time: float = 0.0,
    parameters: Mapping[str, object] | None = None,
) -> None:
    """Write a run file atomically. Raises OSError.

    Args:
        file: The run file.
        result: The test.
        history: The command.
        wall_time: Its duration, s.
        parameters: Further values that determine the result, for JSON.
    """
    with new_netcdf(file, 200_000 + 1_000 * len(result.vector)) as dataset:
        describe(dataset, "labkit run predicted by the constitutive model", history)
        dataset.setncatts(
            {
                "labkit_file": "run",
                "labkit_version": labkit.__version__,
                "engine_version": labkit.__version__,
                "scene": dataclasses.replace(Scene(), young_modulus=result.model.young_modulus).to_json(),
                **_attributes(result, parameters or {}),
                "wall_time": float(wall_time),
                "steps": np.int64(result.calls),
                "provenance": provenance_json(history or None, output=file),
            }
        )
        create_variables(dataset, _variables(result), {})
        dataset.createDimension("snapshot", None)
        create_variables(dataset.createGroup("contacts"), CONTACTS, {})
        dataset["contacts"]["row_size"].sample_dimension = "contact"
        create_variables(dataset.createGroup("grains"), GRAINS, {"grain": 0})
        for name, values in records_of_result(result).items():
            dataset[name][:] = values


def model_of(run: xr.Dataset) -> Model | None:
    """Return the model that predicted a run, or None for a simulation."""
    return Model.from_json(run.attrs["model"]) if run.attrs.get("engine") == MODEL_ENGINE else None


def read_model(file: str | os.PathLike[str] | None) -> Model:
    """Read a model from a JSON file written by labkit calibrate; without a file it is that of Table 2.

    Prints a note if the file has changed since: parameters may be edited, but damage should not go unnoticed. Raises
    InputError if the file cannot be read or holds no model.
    """
    if file is None:
        return Model()
    try:
        model = Model.from_json(Path(file).read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{file} cannot be read ({getattr(error, 'strerror', error)}): give a JSON file written by labkit calibrate"
        ) from None
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    if has_changed(file):
        print(f"labkit: {file} has changed since labkit wrote it", file=sys.stderr, flush=True)
    return model
