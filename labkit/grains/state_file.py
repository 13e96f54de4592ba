"""State files: writes and reads a State, also the State at the end or at a snapshot of a run file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np

from labkit.bodies.kinds import bodies_in_run, read_bodies
from labkit.errors import InputError, require_file_name
from labkit.files.hashes import values_of
from labkit.files.netcdf import MARGIN, create_variables, damage_error, labkit_kind, new_netcdf, open_netcdf
from labkit.files.schema import STATE, description
from labkit.grains.columns import read_columns
from labkit.grains.ledger import Ledger
from labkit.grains.scene import Scene
from labkit.grains.state import State, state_of_snapshot
from labkit.grains.valid import read_valid, require_state
from labkit.micro.bodies import snapshot_of_bodies
from labkit.micro.snapshot import Contacts, Snapshot
from labkit.parameters import Values
from labkit.version import __version__

if TYPE_CHECKING:
    import netCDF4

ATTRIBUTES = ("time", "time_step", "step", "seed", "engine", "engine_version", "history", "recipe", "provenance")


def attributes_of(state: State, kind: str) -> dict[str, object]:
    """Return the attributes common to state and run files; `kind` is state or run."""
    *energies, further = vars(state.ledger).values()
    return {
        "labkit_file": kind,
        "labkit_version": __version__,
        "scene": state.scene.to_json(),
        **{name: getattr(state, name) for name in ATTRIBUTES},
        **({"precision": state.precision} if state.precision != "double" else {}),
        "undrained_stress": np.array(state.undrained_stress or (0.0,) * 9),
        **description(f"labkit {kind} of {state.contents}", state.history),
        "ledger": np.array([*energies, *(further.get(name, 0.0) for name in state.scene.contact_law.losses)]),
    }


def read_group(group: netCDF4.Dataset, attributes: netCDF4.Dataset, contacts: int | None = None) -> State:
    """Read the State in a netCDF group, with its attributes from the dataset `attributes`.

    `contacts` is the number of contacts to read, if the group may have more rows than contacts.
    """
    rows = {name: slice(contacts if "contact" in row.dimensions else None) for name, row in STATE.items()}
    values: Values = {name: values_of(group[name], rows[name]) for name in STATE}
    columns = read_columns(group, slice(contacts), Scene.from_json(attributes.scene))
    return State(**values, columns=columns, clumps=read_bodies(group), **_attributes_of(attributes))


def _attributes_of(dataset: netCDF4.Dataset) -> Values:
    """Return the fields of a State that are stored as attributes of its file."""
    names = (*ATTRIBUTES, "precision")
    scene = Scene.from_json(dataset.scene)
    attributes: Values = {name: getattr(dataset, name) for name in names if name in dataset.ncattrs()}
    attributes |= {name: int(attributes[name]) for name in ("step", "seed") if name in attributes}
    attributes |= {name: float(attributes[name]) for name in ("time", "time_step") if name in attributes}
    attributes["undrained_stress"] = tuple(np.ravel(getattr(dataset, "undrained_stress", ())).tolist())
    if "ledger" in dataset.ncattrs():
        energies = [float(x) for x in dataset.ledger]
        further = dict(zip(scene.contact_law.losses, energies[5:], strict=False))
        start, work, friction, rolling, damping = energies[:5]
        attributes["ledger"] = Ledger(start, work, friction, rolling, damping, further)
    return {"scene": scene, **attributes}


def write_state(path: str | os.PathLike, state: State) -> None:
    """Write a state file atomically. Raises OSError, and InputError for a wrong file name or an impossible State."""
    require_file_name(path, "labkit.write_state('s.state.nc', state)")
    require_state(state)
    with new_netcdf(path, MARGIN + state.nbytes) as dataset:
        dataset.setncatts(attributes_of(state, "state"))
        create_variables(dataset, state.table, state.sizes)
        for name, values in state.arrays.items():
            dataset[name][...] = values


def read_state(path: str | os.PathLike[str], snapshot: int | None = None) -> State:
    """Read the State in a state file, or the last saved State of a run file: for a finished run, its end.

    `snapshot` is the index of a snapshot in a run file, counted from the end if negative. The grains of a snapshot
    are at rest, because snapshots have no velocities, unless the snapshot is from the same time as the last save.
    Raises InputError if the file is missing, damaged, of another kind, or without a checkpoint.
    """
    require_file_name(path, "labkit.read_state('s.state.nc')")
    if labkit_kind(path) == "run":
        with open_netcdf(path, "run") as dataset:
            return state_in_run(path, dataset, snapshot)
    if snapshot is not None:
        raise InputError(f"snapshot {snapshot} is for run files, and {path} is not one: leave it out")
    with open_netcdf(path, "state") as dataset:
        return read_valid(path, lambda: read_group(dataset, dataset))


def state_in_run(path: str | os.PathLike[str], run: netCDF4.Dataset, snapshot: int | None = None) -> State:
    """Return the last saved State of an open run file, or a snapshot as a State. Raises InputError; see read_state."""
    if snapshot is not None:
        sizes = values_of(run["contacts"]["row_size"])
        if not -len(sizes) <= snapshot < len(sizes):
            problem = f"snapshot {snapshot} is not in {path}, which has {len(sizes)}"
            raise InputError(f"{problem}: give a number from 0 to {len(sizes) - 1}")
        at, fields = _snapshot_in(run, snapshot % len(sizes), sizes), _attributes_of(run)
        if at.time != fields.get("time") or "checkpoint" not in run.groups:
            changes = {name: fields[name] for name in fields if name not in ("time", "time_step", "step", "ledger")}
            return read_valid(path, lambda: state_of_snapshot(at).replace(**changes))
    group = checkpoint_of(path, run)
    return read_valid(path, lambda: read_group(group, run, int(group.contacts)))


def _snapshot_in(run: netCDF4.Dataset, number: int, sizes: np.ndarray) -> Snapshot:
    """Return a Snapshot of an open run file; `sizes` are the numbers of contacts in all snapshots of the file."""
    group, grains = run["contacts"], run["grains"]
    record, end = int(values_of(group["record"])[number]), int(sizes[: number + 1].sum())
    names = ("normal", "overlap", "normal_force", "tangential_force", "rolling_moment")
    rows = slice(end - int(sizes[number]), end)
    values = {name: _double(group[name], rows) for name in names}
    columns = read_columns(group, rows, Scene.from_json(run.scene))
    contacts = Contacts(values_of(group["contact_grain"], rows), **values, columns=columns)
    at = {name: values_of(v, number if "snapshot" in v.dimensions else ...) for name, v in grains.variables.items()}
    cell, radius, position = _double(run["cell"])[record], at["radius"].astype(float), at["position"].astype(float)
    time = float(_double(run["time"])[record]) if "time" in run.variables else 0.0
    of_grains = Snapshot(Scene.from_json(run.scene), radius, cell, contacts, position, time)
    return snapshot_of_bodies(of_grains, bodies_in_run(at))


def _double(variable: netCDF4.Variable, rows: object = ...) -> np.ndarray:
    """Return the values of a variable in double precision; a reduced file stores them in single precision."""
    return values_of(variable, rows).astype(float)


def checkpoint_of(path: str | os.PathLike[str], run: netCDF4.Dataset) -> netCDF4.Group:
    """Return the checkpoint group of a run file. Raises InputError if it has none, as in a predicted run."""
    if "checkpoint" not in run.groups:
        raise InputError(f"{path} has no checkpoint: give a state file, or a run file as `labkit run` wrote it")
    group = run["checkpoint"]
    if not 0 <= int(getattr(group, "contacts", -1)) <= len(group.dimensions["contact"]):
        raise damage_error(path, "the number of contacts of its checkpoint is wrong")
    return group
