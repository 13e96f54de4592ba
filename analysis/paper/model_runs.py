"""The constitutive model along the path of a simulation, from the state in which the simulation starts."""

from __future__ import annotations

from pathlib import Path as File

import xarray as xr

from labkit.dem import Path
from labkit.errors import InputError
from labkit.model import Model, ModelState, Result, as_run, drive, isotropic_state, read_model
from labkit.runs import Run

TABLE_2, CALIBRATED = "Table 2", "calibrated"


def models(folder: str | File) -> dict[str, Model]:
    """name -> Model: `Table 2`, and `calibrated` if `folder` holds calibrated.json. Raises InputError.

    They go on beyond e_cmax (reading `flat`), as the loose tests do.
    """
    found = {TABLE_2: Model()}
    file = File(folder) / "calibrated.json"
    if file.exists():
        found[CALIBRATED] = read_model(file)
    return {name: model.reading(beyond_e_cmax="flat") for name, model in found.items()}


def path_of(run: xr.Dataset) -> Path:
    """The loading path along which a run went. Raises InputError if nobody here knows it."""
    found = Run(run).path
    if found is None:
        raise InputError(f"path {run.attrs['path']!r} is unknown here: labkit.use() the file that registers it")
    return found


def start_of(run: xr.Dataset, model: Model, path: Path) -> ModelState:
    """The isotropic state of the model with e, Z and p of the first record of the run; Lambda follows from C0.

    e is the nominal void ratio, which C0 and the strain go with. p is the stress that the path holds, where it holds
    one. Raises InputError if the run starts without contacts.
    """
    e, Z, p = float(run["void_ratio_nominal"][0]), float(run["coordination_number"][0]), run.lab.mean_stress()[0]
    if not Z > 0.0 or not p > 0.0:
        raise InputError("the run starts without contact forces: the model needs some, give another run")
    return isotropic_state(model, e, float(p) if path.control() is None else path.pressure, Z=Z)


def follow(run: xr.Dataset, model: Model) -> Result:
    """The Result of the model along the path of `run`. Raises InputError."""
    path = path_of(run)
    return drive(model, path, start_of(run, model, path))


def model_run(run: xr.Dataset, model: Model) -> xr.Dataset:
    """The same as an xarray.Dataset, as labkit.open_run gives. Raises InputError.

    Where the equations end before the path, it ends there (attribute `complete` = 0).
    """
    return as_run(follow(run, model))
