"""The checkpoint of a run: the State from which the run can be resumed, in the group `checkpoint` of the run file.

A run resumes only a run of the same parameters; `differences` says which differ.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from labkit.errors import as_typed
from labkit.files.hashes import DamagedVariable, values_of
from labkit.files.netcdf import create_variables
from labkit.grains.state import State
from labkit.paths.ending import Endings
from labkit.records.ratcheting import Ratcheting
from labkit.servo.reach import Lag

if TYPE_CHECKING:
    import netCDF4


@dataclasses.dataclass(eq=False)
class Position:
    """Position of a run on its path.

    Args:
        step_in_span: Index of the current step of the path within its span (Schedule).
        lattice: Integer matrix U (3, 3) accumulated over all cell replacements so far (labkit.grains.lattice).
        skipped: Number of planned time steps minus the number computed, at the last stop.
        stress: Stress at which the current step started, (3, 3), in Pa.
        lag: How long the servo has been at its limit (labkit.servo.reach).
        regular: True if the last record was made at a regular stop, neither at the start nor at the end of a step.
    """

    step_in_span: int = 0
    lattice: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))
    skipped: int = 0
    stress: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((3, 3)))
    lag: Lag = dataclasses.field(default_factory=Lag)
    regular: bool = False


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A State from which a run can be resumed or with which the run ended, and the progress of the run so far.

    `wall_time` is in s. `endings` says why steps, and the run, ended.
    """

    state: State
    complete: bool
    wall_time: float
    threads: int = 1
    position: Position = dataclasses.field(default_factory=Position)
    endings: Endings = dataclasses.field(default_factory=Endings)
    ratcheting: Ratcheting = dataclasses.field(default_factory=Ratcheting)


def write_checkpoint(dataset: netCDF4.Dataset, point: Checkpoint) -> None:
    """Overwrite the last checkpoint, without compression, so that HDF5 can reuse its space."""
    state = point.state
    contacts = len(state.contact_grain)
    if "checkpoint" not in dataset.groups:
        group = dataset.createGroup("checkpoint")
        sizes = {name: size for name, size in state.sizes.items() if name != "contact"}
        create_variables(group, state.table, sizes, compressed=False)
    group = dataset["checkpoint"]
    group.contacts = np.int64(contacts)
    for name, values in state.arrays.items():
        rows = slice(contacts) if "contact" in state.table[name].dimensions else slice(None)
        group[name][rows] = values
    _write_position(group, point.position)
    _write_ratcheting(group, point.ratcheting)


def _write_position(checkpoint: netCDF4.Group, position: Position) -> None:
    checkpoint.leg, checkpoint.skipped = np.int64(position.step_in_span), np.int64(position.skipped)
    checkpoint.lattice, checkpoint.leg_stress = position.lattice.ravel(), position.stress.ravel()
    checkpoint.lag = np.array(dataclasses.astuple(position.lag))
    checkpoint.regular = np.int8(position.regular)


CREATED = "ratcheting_work"  # a variable in the group `checkpoint`; data_sha256 does not cover this group


def _write_ratcheting(checkpoint: netCDF4.Group, ratcheting: Ratcheting) -> None:
    if CREATED not in checkpoint.variables:
        checkpoint.createDimension("record", None)
        created = checkpoint.createVariable(CREATED, "f8", ("record",), fletcher32=True, chunksizes=[256])
        created.units, created.long_name = "J", "energy created by the factor that avoids ratcheting"
    checkpoint[CREATED][: len(ratcheting.work)] = ratcheting.work
    checkpoint.ratcheting = np.array([ratcheting.power, ratcheting.time])


def ratcheting_of(checkpoint: netCDF4.Group, records: int) -> Ratcheting:
    """Read the Ratcheting of a checkpoint with `records` records. Raises DamagedVariable."""
    if CREATED not in checkpoint.variables:
        raise DamagedVariable(f"{CREATED} is missing")
    power, time = map(float, checkpoint.ratcheting)
    return Ratcheting(values_of(checkpoint[CREATED], slice(records)).tolist(), power, time)


def position_of(checkpoint: netCDF4.Group) -> Position:
    """Read the Position of a checkpoint."""
    return Position(
        int(checkpoint.leg),
        np.reshape(checkpoint.lattice, (3, 3)),
        int(checkpoint.skipped),
        np.reshape(checkpoint.leg_stress, (3, 3)),
        Lag(*map(float, checkpoint.lag)),
        bool(getattr(checkpoint, "regular", True)),  # a file of 0.2.0.dev0 does not say
    )


Parameters = Mapping[str, object]

CODE_OF_LAW = "code_of_law"  # setting: a hash of the code of a user-defined contact law
NAMES = ("label", "durations")  # fields of steps that only appear in messages and output
MOST_SHOWN, LONGEST = 3, 60  # differences in a message, and characters of a value


def differences(stored: Parameters, requested: Parameters) -> str:
    """Return the parameters and settings in which two runs differ, each with both values; empty if they are the same.

    The label of a step is no difference, nor is the code of a law that the file of an earlier version lacks. If the
    path differs, only the path is named.

    Args:
        stored: `path` and the attribute `path_parameters` of the run in the file.
        requested: Those of the run to be carried out.
    """
    if stored["path"] != requested["path"]:
        stored, requested = {"path": stored["path"]}, {"path": requested["path"]}
    ours, theirs = _flat(stored), _flat(requested)
    ours.setdefault(CODE_OF_LAW, theirs.get(CODE_OF_LAW))
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    said = [_said(name, ours.get(name, "not set"), theirs.get(name, "not set")) for name in names[:MOST_SHOWN]]
    return "; ".join(said) + (f"; {len(names) - MOST_SHOWN} more differ" if len(names) > MOST_SHOWN else "")


def _flat(parameters: Parameters) -> dict[str, object]:
    """Return name -> value, with the fields of each step of a path by names such as `strain of step 2`."""
    flat: dict[str, object] = {}
    for name, value in parameters.items():
        if isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            flat[f"number of {name}"] = len(value)
            for number, each in enumerate(value, 1):
                of_step = f"of step {number}" if name == "steps" else f"of {name} {number}"
                flat |= {f"{field} {of_step}": value for field, value in each.items() if field not in NAMES}
        else:
            flat[name] = value
    return flat


def _said(name: str, *values: object) -> str:
    """Say both values of a parameter, with all digits if the shortened values look the same."""
    short = [as_typed(tuple(value) if isinstance(value, list) else value) for value in values]
    texts = short if short[0] != short[1] else [repr(value) for value in values]
    if any(len(text) > LONGEST for text in texts):
        return f"{name} differs"
    return f"{name} is {texts[0]} in the file, {texts[1]} here"
