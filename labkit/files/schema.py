"""Schema of state and run files: name, dimensions, type, units and long name of variables; types of attributes.

`require_schema` compares an open file with the schema. labkit.grains.state and labkit.micro.snapshot check the values
of a State and of contacts.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable, Container, Hashable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from labkit.errors import InputError

if TYPE_CHECKING:
    import netCDF4


@dataclasses.dataclass(frozen=True)
class Variable:
    """A variable of a file: dimensions and type in netCDF terms, units and long name as CF requires."""

    name: str
    dimensions: tuple[str, ...]
    dtype: str
    units: str
    long_name: str

    @property
    def attributes(self) -> dict[str, str]:
        """The units and the long name as attributes of an xarray variable, and what CF requires for ragged arrays."""
        ragged = {"sample_dimension": "contact"} if self.name == "row_size" else {}
        return {"units": self.units, "long_name": self.long_name, **ragged}


def _table(*rows: tuple[str, str, str, str, str]) -> dict[str, Variable]:
    return {row[0]: Variable(row[0], tuple(row[1].split()), *row[2:]) for row in rows}


STATE = _table(
    ("radius", "grain", "f8", "m", "grain radius"),
    ("position", "grain i", "f8", "m", "position of the grain centre, not wrapped into the cell"),
    ("velocity", "grain i", "f8", "m s-1", "grain velocity including the mean field, half a time step earlier"),
    ("angular_velocity", "grain i", "f8", "rad s-1", "angular velocity of the grain, half a time step earlier"),
    ("cell", "i j", "f8", "m", "periodic cell, cell vectors as columns"),
    ("velocity_gradient", "i j", "f8", "s-1", "velocity gradient of the cell"),
    ("contact_grain", "contact side", "i4", "1", "first and second grain of the contact"),
    ("contact_shift", "contact i", "i4", "1", "periodic shift of the second grain, in cell vectors"),
    ("tangential_force", "contact i", "f8", "N", "tangential contact force on the first grain"),
    ("rolling_moment", "contact i", "f8", "N m", "rolling resistance moment on the first grain"),
)

# Further history variables of contacts, which the parts of contact laws declare (labkit.grains.laws.parts.Column); a
# file contains the variables of its law.
HISTORY: dict[str, Variable] = {}

RECORD = _table(
    ("time", "time", "f8", "s", "time since the start of the path"),
    ("axial_strain", "time", "f8", "1", "logarithmic axial strain"),
    ("strain", "time i j", "f8", "1", "logarithmic strain, compression positive"),
    ("cell", "time i j", "f8", "m", "periodic cell, cell vectors as columns"),
    ("volume", "time", "f8", "m3", "volume of the cell"),
    ("stress", "time i j", "f8", "Pa", "Love's stress, compression positive"),
    ("stress_sff", "time i j", "f8", "Pa", "stress predicted by stress-force-fabric equation C0, compression positive"),
    ("void_ratio", "time", "f8", "1", "void ratio"),
    ("void_ratio_nominal", "time", "f8", "1", "nominal void ratio, of the undeformed grains"),
    ("coordination_number", "time", "f8", "1", "coordination number Z"),
    ("contact_anisotropy", "time i j", "f8", "1", "anisotropy of the contact normals A"),
    ("mean_normalised_force", "time", "f8", "1", "mean normalised normal contact force Lambda"),
    ("normal_force_anisotropy", "time i j", "f8", "1", "anisotropy of the normalised normal force F"),
    ("mobilisation", "time i j", "f8", "1", "mobilisation F^t: mean normal (x) tangential force / mean normal force"),
    ("inertial_number", "time", "f8", "1", "inertial number"),
    ("overlap_ratio", "time", "f8", "1", "mean of overlap over grain diameter"),
    ("rattler_fraction", "time", "f8", "1", "share of grains with fewer than two contacts"),
    ("kinetic_energy", "time", "f8", "J", "kinetic energy relative to the mean field"),
    ("unbalanced_force", "time", "f8", "1", "mean resultant force on a grain over mean contact force"),
    ("elastic_energy", "time", "f8", "J", "elastic energy of the contact springs"),
    ("cell_work", "time", "f8", "J", "work of the cell on the grains since the start of the path"),
    ("friction_loss", "time", "f8", "J", "energy dissipated by sliding"),
    ("rolling_loss", "time", "f8", "J", "energy dissipated by rolling at the moment limit"),
    ("damping_loss", "time", "f8", "J", "energy dissipated by local damping or dashpots"),
    ("energy_balance_error", "time", "f8", "1", "energy unaccounted for, over work of the cell or initial energy"),
    ("drift_velocity", "time i", "f8", "m s-1", "velocity of the centre of mass relative to the mean field"),
)

# The equation by volume: names of the printed one followed by `_by_volume`. Files of earlier versions lack them.
BY_VOLUME = _table(
    (
        "stress_sff_by_volume",
        "time i j",
        "f8",
        "Pa",
        "stress predicted by the equation by volume, compression positive",
    ),
    ("mean_normalised_force_by_volume", "time", "f8", "1", "mean normalised normal contact force Lambda by volume"),
)

# Variables that runs of grains that are not spheres also record (labkit.micro.eccentricity).
ECCENTRICITY = _table(
    ("contact_eccentricity", "time i j", "f8", "1", "mean tangential contact vector G, over the mean normal one"),
    ("normal_force_eccentricity", "time i j", "f8", "1", "M: mean tangential contact vector (x) normal force"),
    ("tangential_force_eccentricity", "time i j", "f8", "1", "X: mean tangential contact vector (x) tangential force"),
)

# Energies dissipated by further mechanisms, which parts of laws declare (labkit.grains.laws.parts.LawPart.losses); runs
# with such a law record them.
LOSSES: dict[str, Variable] = {}

# A run file must contain these variables. Others may be missing in files of earlier versions or other programs, and are
# then read as NaN.
ESSENTIAL = ("axial_strain", "strain", "cell", "volume", "stress")

CONTACTS = _table(
    ("record", "snapshot", "i4", "1", "index of the snapshot along time"),
    ("row_size", "snapshot", "i4", "1", "number of contacts in the snapshot"),
    ("contact_grain", "contact side", "i4", "1", "first and second grain of the contact"),
    ("normal", "contact i", "f8", "1", "unit normal from the first to the second grain"),
    ("overlap", "contact", "f8", "m", "penetration depth"),
    ("normal_force", "contact", "f8", "N", "normal contact force, compression positive"),
    ("tangential_force", "contact i", "f8", "N", "tangential contact force on the first grain"),
    ("rolling_moment", "contact i", "f8", "N m", "rolling resistance moment on the first grain"),
)

GRAINS = _table(
    ("radius", "grain", "f8", "m", "grain radius"),
    ("position", "snapshot grain i", "f8", "m", "position of the grain centre, not wrapped into the cell"),
)


class Spheres:
    """The kind of bodies that consist of one grain each; it has no variables."""

    table: ClassVar[dict[str, Variable]] = {}
    of_run: ClassVar[dict[str, Variable]] = {}


# Kinds of bodies made of several grains, by the variable that identifies the kind. Their variables are `table` in a
# state and `of_run` in the group `grains` of a run. Each kind registers itself here (labkit.bodies.kinds).
BodyKind: TypeAlias = Any  # a class of labkit.bodies, in a room above
BODIES: dict[str, BodyKind] = {}


def kind_of_bodies(names: Container[object]) -> BodyKind:
    """Return the kind of the bodies in a file with variables of these names: one of BODIES, or Spheres."""
    return next((BODIES[name] for name in reversed(BODIES) if name in names), Spheres)


def number_of_bodies(sizes: Mapping[Hashable, int]) -> int:
    """Return the number of bodies, or of grains if there are none, from the dimensions of a file; 0 without either."""
    return sizes.get("clump", sizes.get("grain", 0))


SIZES = {"i": 3, "j": 3, "side": 2, "quaternion": 4}
AXES = {"i": list("xyz"), "j": list("xyz")}  # labels of the components of vectors and tensors


# --- attributes -----------------------------------------------------------------------------------------------------


def _is_json(value: object) -> bool:
    """Return True for a JSON object or an empty text."""
    try:
        return isinstance(value, str) and (value == "" or isinstance(json.loads(value), dict))
    except (ValueError, RecursionError):
        return False


def is_provenance(record: object) -> bool:
    """Return True if parsed JSON has the structure of a provenance (labkit.files.provenance.provenance_json)."""
    if not isinstance(record, dict) or not isinstance(inputs := record.get("inputs", []), list):
        return False
    tables = (record.get("machine", {}), record.get("libraries", {}), *inputs)
    named = (item.get(name) for item in inputs if isinstance(item, dict) for name in ("file", "sha256"))
    return all(isinstance(table, dict) for table in tables) and all(isinstance(name, str) for name in named)


def _is_whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and int(value) >= 0


def _are_energies(value: object) -> bool:
    """Return True for the initial energy, the work and at least three dissipated energies, which may be unknown."""
    values = np.asarray(value)
    if values.ndim != 1 or len(values) < 5 or values.dtype.kind != "f" or not np.isfinite(values[:2]).all():
        return False
    return bool(np.isfinite(values[2:]).all() or np.isnan(values[2:]).all())


def _is_stress(value: object) -> bool:
    values = np.asarray(value)
    return values.shape == (9,) and values.dtype.kind == "f" and bool(np.isfinite(values).all())


Check = tuple[Callable[[object], bool], str]
TEXT: Check = (lambda value: isinstance(value, str), "text")
JSON: Check = (_is_json, "a JSON object")
PROVENANCE: Check = (
    lambda value: _is_json(value) and is_provenance(json.loads(str(value) or "{}")),
    "a provenance in JSON",
)
COUNT: Check = (_is_whole, "a whole number")
TIME_SPAN: Check = (
    lambda value: isinstance(value, (int, float, np.floating)) and bool(0.0 <= value < math.inf),
    "a time in s",
)
STRESS: Check = (_is_stress, "nine stresses")
FLAG: Check = (lambda value: _is_whole(value) and value in (0, 1), "0 or 1")
ENERGIES: Check = (_are_energies, "at least five energies")

ATTRIBUTES: dict[str, tuple[Check, str]] = {  # attributes of any kind of file: check of the value, meaning
    "scene": (JSON, "material and contact law"),
    "path": (TEXT, "name of the loading path"),
    "path_parameters": (JSON, "its parameters, and the options of the run"),
    "provenance": (PROVENANCE, "command, version, time, inputs and computer"),
    "recipe": (JSON, "how the specimen was made; empty if it was imported"),
    "history": (TEXT, "what was done to the specimen before"),
    "engine": (TEXT, "engine that wrote the file"),
    "engine_version": (TEXT, "its version"),
    "precision": (TEXT, "precision of the engine, unless it is double"),
    "ended_because": (TEXT, "why a run ended before its aim; empty if it did not"),
    "endings": (
        JSON,
        "why steps of a run, and the run, ended: `met`, the number of steps that a condition ended, and `last`, the "
        "last five of them and the end of the run: `step`, `cause`, `what`, values `reached` and one record `before`",
    ),
    "specimen": (TEXT, "hash of the State from which a run started"),
    "data_sha256": (TEXT, "hash of all values, the same whenever the same data are produced"),
    "time": (TIME_SPAN, "time since the specimen was generated"),
    "time_step": (TIME_SPAN, "time step"),
    "wall_time": (TIME_SPAN, "duration of the computation"),
    "step": (COUNT, "number of time steps since the specimen was generated"),
    "steps": (COUNT, "number of time steps of the run"),
    "seed": (COUNT, "seed of the specimen"),
    "threads": (COUNT, "number of threads"),
    "complete": (FLAG, "1 if the path was followed to its end"),
    "undrained_stress": (STRESS, "Pa: effective stress at the start of undrained loading that led here; 0 if drained"),
    "undrained_before": (STRESS, "Pa: the same at the start of the run, from which r_u counts if it goes on undrained"),
    "ledger": (
        ENERGIES,
        "J: energy at the start, work done on the cell, and energy lost to friction, rolling, damping and otherwise",
    ),
}
NEEDED = {  # attributes without which a file cannot be used
    "state": ("scene", "time", "time_step", "step", "seed"),
    "run": ("scene", "path", "path_parameters", "complete"),
}


# --- comparison with a file -----------------------------------------------------------------------------------------


def require_schema(path: str | os.PathLike[str], dataset: netCDF4.Dataset, kind: str) -> None:
    """Raise InputError, naming the file, unless an open file has the variables, shapes and attributes of its kind."""
    for problem in _problems(dataset, kind):
        again = "repeat the run" if kind == "run" else "create it again"
        raise InputError(f"{path} is damaged ({problem}): {again}")


def _problems(dataset: netCDF4.Dataset, kind: str) -> Iterator[str]:
    for group, table, essential, exact in _tables(dataset, kind):
        yield from (f"{name} is missing" for name in essential if group is None or name not in group.variables)
        for name in table if group is not None else ():
            if name in group.variables and (problem := _variable_problem(group[name], table[name], exact)):
                yield problem
    for variable in (each for group in (dataset, *dataset.groups.values()) for each in group.variables.values()):
        for name in {"scale_factor", "add_offset"} & set(variable.ncattrs()):
            if np.asarray(variable.getncattr(name)).dtype.kind not in "iuf":
                yield f"{name} of {variable.name} is not a number"
    yield from _attribute_problems(dataset, kind)
    if kind == "run":
        yield from _snapshot_problems(dataset)


def _tables(dataset: netCDF4.Dataset, kind: str) -> Iterator[tuple[Any, Mapping[str, Variable], Any, bool]]:
    """Yield (group, its table, required variables, True if single precision is rejected) for a kind of file."""
    if kind == "state":
        bodies = kind_of_bodies(dataset.variables).table
        yield dataset, {**STATE, **HISTORY, **bodies}, {**STATE, **bodies}, True
    if kind == "run":
        yield dataset, RECORD | BY_VOLUME | ECCENTRICITY, ESSENTIAL, False
        yield dataset.groups.get("contacts"), {**CONTACTS, **HISTORY}, CONTACTS, False
        grains, checkpoint = (dataset.groups.get(name) for name in ("grains", "checkpoint"))
        names = [name for group in (grains, checkpoint) if group is not None for name in group.variables]
        rows = {**GRAINS, **kind_of_bodies(names if grains is None else grains.variables).of_run}
        yield grains, rows, rows, False
        if checkpoint is not None:
            bodies = kind_of_bodies(names).table
            yield checkpoint, {**STATE, **HISTORY, **bodies}, {**STATE, **bodies}, True


def _variable_problem(variable: netCDF4.Variable, expected: Variable, exact: bool) -> str | None:
    """Return what is wrong with the type or the shape of a variable, or None."""
    if variable.dimensions != expected.dimensions:
        dimensions, allowed = (", ".join(row.dimensions) for row in (variable, expected))
        return f"{expected.name} has the dimensions ({dimensions}), not ({allowed})"
    kind, actual = np.dtype(expected.dtype), variable.dtype
    if not isinstance(actual, np.dtype) or actual.kind != kind.kind or (exact and actual != kind):
        return f"{expected.name} has the type {actual}, not {kind}"
    for dimension, size in zip(expected.dimensions, variable.shape, strict=True):
        if SIZES.get(dimension, size) != size:
            return f"{expected.name} has {size} components along {dimension}, not {SIZES[dimension]}"
    return None


def _attribute_problems(dataset: netCDF4.Dataset, kind: str) -> Iterator[str]:
    there = dataset.ncattrs()
    yield from (f"the attribute {name} is missing" for name in NEEDED.get(kind, ()) if name not in there)
    for name, ((holds, values), _) in ATTRIBUTES.items():
        if name in there and not holds(dataset.getncattr(name)):
            yield f"the attribute {name} is not {values}"


def _snapshot_problems(dataset: netCDF4.Dataset) -> Iterator[str]:
    """Say what is wrong with the sizes of the snapshots of a run, or with its grains."""
    contacts, records = dataset["contacts"], len(dataset.dimensions["time"])
    record, sizes = (np.ma.getdata(contacts[name][...]) for name in ("record", "row_size"))
    if len(record) and not (0 <= record.min() and record.max() < records and (np.diff(record) > 0).all()):
        yield "contacts/record does not list records of the run"
    if (len(sizes) and sizes.min() < 0) or int(sizes.sum(dtype=np.int64)) != len(contacts.dimensions["contact"]):
        yield "the contacts are not those that contacts/row_size counts"
    radius = np.ma.getdata(dataset["grains"]["radius"][...])
    if not (np.isfinite(radius).all() and (radius > 0.0).all() and (radius < LARGEST_RADIUS).all()):
        yield "grains/radius contains values that are not the radii of grains"
    for name in ESSENTIAL:
        if not np.isfinite(values := np.ma.getdata(dataset[name][...])).all() or (np.abs(values) > FILLED).any():
            yield f"{name} contains values that were never recorded"
    if records and not (np.linalg.det(np.ma.getdata(dataset["cell"][...])) > 0.0).all():
        yield "a cell has no volume, or is left-handed"


LARGEST_RADIUS = 1e6  # m
FILLED = 1e36  # netCDF's fill value is 9.97e36

CONVENTIONS = "CF-1.10"
EPOCH = "1970-01-01"
TIME = {"standard_name": "time", "axis": "T", "units": f"seconds since {EPOCH} 00:00:00", "calendar": "standard"}
COMMENT = "The components i and j are x, y, z, with z axial. Compression is positive."
NO_COMMAND = "created with the Python interface of labkit"


def description(title: str, history: str) -> dict[str, str]:
    """Return the global attributes that CF requires; `history` contains commands, one per line, or is empty."""
    return {"Conventions": CONVENTIONS, "title": title, "comment": COMMENT, "history": history or NO_COMMAND}
