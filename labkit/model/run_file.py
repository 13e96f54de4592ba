"""A Result of the model as a run file: the same variables as a simulation's, so that the same code reads both.

What has no meaning without grains is NaN (inertial number, overlap, rattlers, kinetic energy, unbalanced force,
drift); the groups `contacts` and `grains` are there and empty. Both stresses are C0, and both void ratios the e
of the model. The cell is a cube of 1 m at zero strain. The attribute `engine` is `model`.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

import labkit
import labkit.runs.dataset  # gives the accessor .lab to as_run
from labkit.dem.paths import travelled
from labkit.dem.scene import Scene
from labkit.errors import InputError
from labkit.io.files import create_variables, whole_file
from labkit.io.provenance import data_sha256, provenance
from labkit.io.schema import CONTACTS, GRAINS, RECORD
from labkit.model.driver import Result
from labkit.model.parameters import Model

ENGINE = "model"


def records(result: Result) -> dict[str, np.ndarray]:
    """The variables of labkit.io.schema.RECORD of a Result, name -> array along time."""
    principal, direction = np.linalg.eigh(result.strain)
    cell = (direction * np.exp(-principal)[:, None, :]) @ np.swapaxes(direction, 1, 2)
    known = {
        "time": travelled(result.axial_strain) / result.path.rate,
        "axial_strain": result.axial_strain,
        "strain": result.strain,
        "cell": cell,
        "volume": np.linalg.det(cell),
        "stress": result.stress,
        "stress_sff": result.stress,
        "void_ratio": result.e,
        "void_ratio_nominal": result.e,
        "coordination_number": result.Z,
        "contact_anisotropy": result.A,
        "mean_normalised_force": result.Lam,
        "normal_force_anisotropy": result.F,
        "mobilisation": result.Ft,
    }
    size = {"time": len(result), "i": 3}
    absent = {
        name: np.full([size[d] for d in variable.dimensions], np.nan)
        for name, variable in RECORD.items()
        if name not in known
    }
    return {**known, **absent}


def as_run(result: Result) -> xr.Dataset:
    """The Result as labkit.open_run would give its run file, without the file: for labkit.visuals.plots."""
    values = records(result)
    attributes = {name: {"units": v.units, "long_name": v.long_name} for name, v in RECORD.items()}
    run = xr.Dataset(
        {name: (v.dimensions, values[name], attributes[name]) for name, v in RECORD.items()},
        attrs={"engine": ENGINE, "path": result.path.name, "complete": int(result.failure is None)},
    )
    return run.set_coords(["time", "axial_strain"])


def write_result(
    file: str | os.PathLike[str],
    result: Result,
    history: str = "",
    wall_time: float = 0.0,
    parameters: dict[str, Any] | None = None,
) -> None:
    """Writes a run file, whole or not at all.

    history: the command; wall_time: s; parameters: what else decides the result, for JSON. Raises OSError.
    """
    with whole_file(file) as temporary, netCDF4.Dataset(temporary, "w") as dataset:
        dataset.Conventions = "CF-1.10"
        dataset.labkit_file = "run"
        dataset.labkit_version = dataset.engine_version = labkit.__version__
        dataset.engine = ENGINE
        dataset.scene = dataclasses.replace(Scene(), young_modulus=result.model.young_modulus).to_json()
        dataset.model = result.model.to_json()
        dataset.setncattr("path", result.path.name)  # `dataset.path` is netCDF4's own
        dataset.path_parameters = json.dumps(result.path.parameters() | (parameters or {}))
        dataset.complete = np.int32(result.failure is None)
        dataset.failure = result.failure or ""
        dataset.wall_time = float(wall_time)
        dataset.steps = np.int64(result.calls)
        dataset.history = history
        dataset.provenance = provenance(history or None, output=file)
        create_variables(dataset, RECORD, {})
        dataset.createDimension("snapshot", None)
        create_variables(dataset.createGroup("contacts"), CONTACTS, {})
        dataset["contacts"]["row_size"].sample_dimension = "contact"
        create_variables(dataset.createGroup("grains"), GRAINS, {"grain": 0})
        for name, values in records(result).items():
            dataset[name][:] = values
        dataset.data_sha256 = data_sha256(dataset)


def model_of(run: xr.Dataset) -> Model | None:
    """The Model that made a run file, or None for a simulation."""
    return Model.from_json(run.attrs["model"]) if run.attrs.get("engine") == ENGINE else None


def read_model(file: str | None) -> Model:
    """The Model of a JSON file of labkit calibrate, Table 2 without a file. Raises InputError."""
    if file is None:
        return Model()
    try:
        return Model.from_json(Path(file).read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{file} cannot be read ({getattr(error, 'strerror', error)}): give a JSON file of labkit calibrate"
        ) from None
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
