"""Writes a Result of the model as a run file with the variables of a simulation, so that the same code reads both.

Quantities that have no meaning without grains are NaN (inertial number, overlap, rattlers, kinetic energy, unbalanced
force, drift); the groups `contacts` and `grains` are present but empty. Both stresses are computed from C0, and both
void ratios are the e of the model. The cell is a cube of 1 m at zero strain. The attribute `engine` is `model`.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from labkit.errors import InputError, notice
from labkit.files.provenance import has_changed
from labkit.files.schema import Variable
from labkit.grains.scene import Scene
from labkit.model.driver import Result
from labkit.model.law import ConstitutiveLaw
from labkit.model.parameters import Model
from labkit.model.registry import MODELS
from labkit.parameters import Values
from labkit.paths.programme import PROGRESS
from labkit.paths.rates import rate_of
from labkit.results.without_grains import complete_records, records_as_run, write_records
from labkit.text.foreign import content_of, note_file

MODEL_ENGINE = "model"


def records_of_result(result: Result) -> dict[str, np.ndarray]:
    """Return the variables of files.schema.RECORD and of Path.recorded for a Result: arrays along time by name."""
    principal, direction = np.linalg.eigh(result.strain)
    cell = (direction * np.exp(-principal)[:, None, :]) @ np.swapaxes(direction, 1, 2)
    records = {
        "time": result.accumulated_strain / rate_of(result.path),
        **result.model.variables(result.vector, result.stress),
        **({"stress_sff": result.stress} if isinstance(result.model, Model) else {}),
        "cell": cell,
        "volume": np.linalg.det(cell),
    }
    return {**complete_records(records, len(result)), **result.progress}


def as_run(result: Result) -> xr.Dataset:
    """Return the Dataset that labkit.open_run would return for the run file of a Result, without writing a file."""
    return records_as_run(records_of_result(result), _attributes(result, {}), _programme_rows(result))


def _programme_rows(result: Result) -> dict[str, Variable]:
    """Return the variables that the run file of this Result has in addition to the variables of every run file."""
    return PROGRESS if result.path.has_programmes else {}


def _attributes(result: Result, parameters: Mapping[str, object]) -> dict[str, object]:
    """Return attributes that identify the test by its path and `parameters`, and that say how the test ended."""
    return {
        "scene": dataclasses.replace(Scene(), young_modulus=result.model.young_modulus).to_json(),
        "engine": MODEL_ENGINE,
        "path": result.path.name,
        "path_parameters": json.dumps({**dataclasses.asdict(result.path), **parameters}),
        "complete": np.int32(result.failure is None),
        "model": result.model.to_json(),
        "ended_because": result.failure or result.endings.reason,
        "endings": result.endings.to_json(),
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
        history: The command that computed the result.
        wall_time: Duration of the computation, s.
        parameters: Further values that determine the result, stored as JSON.
    """
    attributes = {
        **_attributes(result, parameters or {}),
        "wall_time": max(0.0, float(wall_time)),  # the clock may be set back
        "steps": np.int64(result.calls),
    }
    title = "labkit run predicted by the constitutive model"
    write_records(file, records_of_result(result), attributes, title, history, _programme_rows(result))


def model_of(run: xr.Dataset) -> Model | None:
    """Return labkit's model if it predicted a run, or None for a simulation and for other laws."""
    ours = run.attrs.get("engine") == MODEL_ENGINE and "law" not in json.loads(run.attrs["model"])
    return Model.from_json(run.attrs["model"]) if ours else None


def read_model(file: str | os.PathLike[str] | None) -> Model:
    """Read a model from a JSON file written by labkit calibrate; without a file, return the model of Table 2.

    Prints a note if the file was changed afterwards: parameters may be edited, but damage should not go unnoticed.
    Raises InputError if the file cannot be read or holds no model.
    """
    if file is None:
        return Model()
    try:
        model = Model.from_json(content_of(Path(file)).decode())
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"{file} cannot be read ({getattr(error, 'strerror', error)}): give a JSON file written by labkit calibrate"
        ) from None
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    note_file(file)
    if has_changed(file):
        notice(f"{file} has changed since labkit wrote it")
    return model


def read_law(name: str, file: str | os.PathLike[str] | None) -> ConstitutiveLaw:
    """Return the law that `name` names, with the parameters in a JSON file or, without a file, its defaults.

    The file must be written by RateLaw.to_json or, for the law `labkit`, by labkit calibrate. Raises InputError.
    """
    kind = MODELS.require(name)
    if kind is Model:
        return read_model(file)
    if file is None:
        return kind()
    try:
        stored = json.loads(content_of(Path(file)))
        if stored["law"] != name:
            raise InputError(f"{file} holds parameters of {stored['law']}: give --model {stored['law']}")
        note_file(file)
        values: Values = stored["parameters"]
        return kind(**values)
    except (OSError, ValueError, KeyError, TypeError) as error:
        example = kind().to_json()
        raise InputError(f"{file} cannot be read ({error}): give a JSON file like {example}") from None
