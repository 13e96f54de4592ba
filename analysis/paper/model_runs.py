"""The constitutive model along the loading path of a simulation, from its initial state."""

from __future__ import annotations

from pathlib import Path as File
from typing import cast

import xarray as xr

from labkit.errors import InputError
from labkit.model import Model, ModelState, Result, as_run, drive, isotropic_state, read_model
from labkit.paths import Path, StressPath
from labkit.results import Run

TABLE_2, CALIBRATED = "Table 2", "calibrated"


def models(folder: str | File) -> dict[str, Model]:
    """Name -> Model: `Table 2`, and `calibrated` if `folder` contains calibrated.json. Raises InputError.

    The models continue beyond e_cmax (beyond_e_cmax = flat), as the loose tests do.
    """
    chosen = {TABLE_2: Model()}
    file = File(folder) / "calibrated.json"
    if file.exists():
        chosen[CALIBRATED] = read_model(file)
    return {name: model.reading(beyond_e_cmax="flat") for name, model in chosen.items()}


def path_of(run: xr.Dataset) -> Path:
    """Loading path of a run. Raises InputError if it is not registered."""
    path = Run(run).path
    if path is None:
        raise InputError(f"unknown path {run.attrs['path']!r}: load the file that registers it with labkit.use()")
    return path


def start_of(run: xr.Dataset, model: Model, path: Path) -> ModelState:
    """Isotropic state of the model with e, Z and p of the first record of the run; Lambda follows from C0.

    e is the nominal void ratio, the one consistent with C0 and the strain. p is the stress that the path holds, if
    it holds one. Raises InputError if the run starts without contact forces.
    """
    e, Z, p = float(run["void_ratio_nominal"][0]), float(run["coordination_number"][0]), run.lab.mean_stress()[0]
    if not Z > 0.0 or not p > 0.0:
        raise InputError("the run starts without contact forces, which the model needs: choose another run")
    held = cast(StressPath, path).pressure if path.control() is not None else None
    return isotropic_state(model, e, float(p) if held is None else held, Z=Z)


def follow(run: xr.Dataset, model: Model) -> Result:
    """Result of the model along the path of `run`. Raises InputError."""
    path = path_of(run)
    return drive(model, path, start_of(run, model, path))


def model_run(run: xr.Dataset, model: Model) -> xr.Dataset:
    """Result of the model along the path of `run` as an xarray.Dataset like that of labkit.open_run.

    If the integration stops before the end of the path, so does the run (attribute `complete` = 0). Raises InputError.
    """
    return as_run(follow(run, model))
